#pragma once
/// @file What a model has answered, kept whatever ends the run, so that it is not paid for twice.
#include <fstream>
#include <string>

#include "knothe/assimilation/inference/model_evaluator.hpp"

namespace knothe::assimilation {

/// What became of the journal of an earlier run.
struct KeptCalls {
  Eigen::Index taken = 0;  ///< calls that need not be made again
  std::string refused;     ///< why nothing was taken, a clause; empty: there was no file, or it was taken
};

/// A file of JSON lines. The first: {"kind":"model calls","schema_version":2,"identity":…}, what must be the
/// same for the answers to hold (the server, its model, its configuration). Then one line per call, as it is
/// answered: ["evaluate"|"gradient"|"jacobian"|"hessian",[point],[sensitivity],[answer]]. A run that is
/// killed leaves at most its last line torn, which is not read.
class EvaluationJournal {
 public:
  EvaluationJournal(std::string path, std::string identity);

  /// Reads what there is into `evaluator`, then writes all that its model answers from now on. Three of the
  /// points are evaluated again: where the model answers otherwise than it did (by more than 1e-9 of the
  /// largest value), or the identity is another, or the file is none of these, nothing is taken and the file
  /// begins again. `evaluator` asks nothing once this is gone. Errors: IoError.
  [[nodiscard]] KeptCalls open(ModelEvaluator& evaluator);
  /// Calls in the file.
  [[nodiscard]] Eigen::Index calls() const { return calls_; }
  [[nodiscard]] const std::string& path() const { return path_; }
  /// Of a run that is done.
  void remove();

 private:
  void read(ModelEvaluator& evaluator, std::vector<ModelCall>& calls, std::string& refused) const;
  void write(const ModelCall& call);

  std::string path_, identity_;
  std::ofstream file_;
  Eigen::Index calls_ = 0;
};

}  // namespace knothe::assimilation

#pragma once
/// @file The full-order model asked beside the updates (docs/explanation/verdict.md, "In the service").
///
/// A question is answered by a thread of its own, at low priority: with a copy of the data it refines the
/// model, assimilates the data with it, and catches up with what has come meanwhile; then the updating thread
/// takes its engine over. Until then that one goes on as before.
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <thread>
#include <vector>

#include "knothe/service/journal/served_model.hpp"

namespace knothe::service {

/// A datum that came or went.
struct DataChange {
  likelihood::DatumPointer datum;  ///< of one that went, its key and step
  bool comes = true;
};
/// What cannot be assimilated is said in the log.
void apply_changes(const std::vector<DataChange>& changes, assimilation::Engine& engine);

/// The updating thread asks, notes what changes, and takes what there is; all else is done by the thread.
class Verifier {
 public:
  struct Question {
    likelihood::DataSet data;
    std::size_t step = 0;  ///< whose posterior it is about: the last
    bool thorough = false;
    std::shared_ptr<const ServedModel> model;  ///< that is used
  };
  /// A step's result by the new model, to be shown in place of the one there was.
  struct Result {
    assimilation::StepResult result;
    std::shared_ptr<const ServedModel> model;
  };
  /// What is used from now on, with all data but the changes that are left; their steps alone are stale.
  struct Handover {
    std::unique_ptr<assimilation::Engine> engine;
    std::shared_ptr<const ServedModel> model;
    std::vector<DataChange> changes;
  };
  /// Called from the thread.
  struct Listener {
    std::function<bool(const Verification&)> store;  ///< puts it on disk; false: it could not
    std::function<void()> wake;                      ///< there is something to take
  };

  /// `project`, `journal`: with the project's own model. ProjectError where there is no full-order model.
  Verifier(const project::Project& project, std::string journal, Listener listener);
  ~Verifier() { stop(); }
  /// Ends the thread, and the solver with it. What was solved is kept.
  void stop();

  [[nodiscard]] bool is_busy() const;   ///< until a handover was taken
  [[nodiscard]] bool has_news() const;  ///< a result, or a handover
  /// Where it is not busy.
  void ask(Question question);
  /// While it is busy.
  void note(DataChange change);
  /// Results first, in the order of their steps.
  [[nodiscard]] std::optional<Result> next_result();
  [[nodiscard]] std::optional<Handover> handover();
  /// Destroys an engine that is no longer needed.
  void discard(std::unique_ptr<assimilation::Engine> engine);

 private:
  void run();
  void answer(const Question& question);
  [[nodiscard]] std::shared_ptr<const ServedModel> refine(const Question& question);
  void hand_over(std::unique_ptr<assimilation::Engine> engine,
                 const std::shared_ptr<const ServedModel>& model);
  void show(Result result);
  [[nodiscard]] bool stopping() const;

  project::Project project_;
  std::string journal_;
  Listener listener_;
  std::stop_source stop_;

  mutable std::mutex mutex_;  ///< everything below; not held while others are called
  std::condition_variable changed_;
  std::optional<Question> question_;
  std::vector<DataChange> changes_;  ///< since it was asked, not applied yet
  std::deque<Result> results_;
  std::optional<Handover> handover_;
  std::unique_ptr<assimilation::Engine> discarded_;
  bool busy_ = false, stopping_ = false;

  std::thread thread_;
};

}  // namespace knothe::service

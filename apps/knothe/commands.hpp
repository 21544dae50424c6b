#pragma once
/// @file The commands of `knothe`: what each takes, one function each. Command line parsing is in main.cpp
/// alone.
#include <optional>
#include <string>
#include <vector>

namespace knothe::commands {

struct CheckArguments {
  std::string project;
  bool options = false;  ///< print the reference of all options instead
  bool schema = false;   ///< print the JSON Schemas of lines instead
};
int check(const CheckArguments& arguments);

struct ModelArguments {
  std::string model;
  bool json = false;
};
int model_info(const ModelArguments& arguments);

struct EvaluateArguments {
  std::string model;
  std::string at;  ///< NAME=V,NAME=V
  int step = 0;
  std::vector<long> dofs;  ///< empty: all
  bool derivatives = false;
  bool json = false;
  std::string output;  ///< .vtu
};
int model_evaluate(const EvaluateArguments& arguments);

struct ImportArguments {
  std::string snapshots;
  std::string output;
  std::string form = "tree";
  int modes = 0;           ///< 0: by the tolerance
  double tolerance = 0.0;  ///< 0: the default of the form
  bool json = false;
};
int model_import(const ImportArguments& arguments);

struct SimulateArguments {
  std::string project;
  std::string model;  ///< separated model; without it the sibling computes the full-order model
  std::string output;
  std::optional<unsigned long> seed;
  bool images = false;  ///< pictures, into the folder `output`
};
int simulate(const SimulateArguments& arguments);

struct AssimilateArguments {
  std::string project;
  std::string method;  ///< overrides the project's
  std::string redo;    ///< FROM:TO, steps to correct; empty: none
  bool json = false;
  std::string results;  ///< overrides the project's
};
int assimilate(const AssimilateArguments& arguments);

struct SelectArguments {
  std::string project;
  bool json = false;
  std::string results;  ///< overrides the project's
};
int select(const SelectArguments& arguments);

struct InferArguments {
  std::string project;
  std::string method;   ///< overrides the project's
  std::string compare;  ///< two methods, comma between
  bool json = false;
  std::string results;  ///< overrides the project's
};
int infer(const InferArguments& arguments);

struct ForecastArguments {
  std::string project;
  bool inverse_map = false;  ///< Eq. 33 with the inverse transport map of the predicted field
  bool json = false;
};
int forecast(const ForecastArguments& arguments);

struct ReportArguments {
  std::string results;
  std::string output;
};
int report(const ReportArguments& arguments);

struct ServeArguments {
  std::string project;
  std::string test;
  std::optional<int> port;
  bool strict_deadline = false;
};
int serve(const ServeArguments& arguments);

struct JournalArguments {
  std::string journal;
  std::string project;  ///< empty: NAME.toml beside NAME.journal
  std::string output;
  bool json = false;
};
int replay(const JournalArguments& arguments);
int recover(const JournalArguments& arguments);
int backup(const JournalArguments& arguments);
int export_journal(const JournalArguments& arguments);

/// `project`: a service that is to run here; empty: the machine alone.
int doctor(const std::string& project, bool sends_alarms);

/// Whether `knothe-offline` is where `run_sibling` finds it.
[[nodiscard]] bool sibling_installed();

/// Runs `knothe-offline` with the words given (the command first); returns its exit status. Throws an Error
/// of status 1 that says how to get it where it is not installed.
int run_sibling(const std::vector<std::string>& words);

}  // namespace knothe::commands

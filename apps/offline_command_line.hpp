#pragma once
/// @file The commands of the offline phase as a person types them: `knothe-offline` runs them, `knothe`
/// passes them on to it.
#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

namespace knothe {

/// What a command line has chosen to do; returns the exit status.
using Command = std::function<int()>;

/// A subcommand with a description and one worked example.
CLI::App& add_command(CLI::App& parent, const std::string& name, const std::string& meaning,
                      const std::string& example);

/// Checks of options that are numbers: > 0, ≥ 0. What is said of another one: "must be a positive number, not
/// -1".
CLI::Validator positive_number();
CLI::Validator number_from_zero();

struct BuildArguments {
  std::string project;
  std::string output;
  std::string method;  ///< overrides the project's
  std::string
      refine;  ///< results folder, around whose last posterior the project's model is refined; or empty
  std::string share;   ///< "I/N": the runs of share I of N alone; or empty
  bool study = false;  ///< also what other numbers of modes, in both forms, would cost
  bool json = false;
};

struct VerifyArguments {
  std::string project;
  std::string model;
  int points = 5;
  unsigned long seed = 1;
  bool json = false;
};

struct MeshStudyArguments {
  std::string project;
  std::vector<double> elements = {0.005, 0.0025, 0.00125};             ///< m
  std::vector<std::string> laws = {"none", "crack-band", "gradient"};  ///< regularisations
  int steps = 0;                                                       ///< 0: the project's
  std::string output;                                                  ///< figure (.svg), none if empty
  bool json = false;
};

/// One run of the project's full-order model at its reference parameters, on all ranks of an MPI job.
struct FullOrderArguments {
  std::string project;
  int refinements = 0;       ///< each cell into 8, so often
  int steps = 0;             ///< 0: the project's
  bool elastic = false;      ///< the elastic solution alone
  double tolerance = 1e-9;   ///< of the linear elastic solution
  int max_iterations = 500;  ///< of conjugate gradients
  std::string output;        ///< field of the last step (.vtu), none if empty
  bool json = false;
};

/// The full-order solution at one point, as a file of snapshots.
struct SolveArguments {
  std::string project;
  std::string at;  ///< NAME=VALUE,…
  std::string output;
};

struct ReproduceArguments {
  bool quick = false;
  bool json = false;
  unsigned long seed = 1;
  std::string output = "reproduction/";
};

/// The command that reads these arguments, below `parent`.
CLI::App& add_command(CLI::App& parent, BuildArguments& arguments);
CLI::App& add_command(CLI::App& parent, VerifyArguments& arguments);
CLI::App& add_command(CLI::App& parent, MeshStudyArguments& arguments);
CLI::App& add_command(CLI::App& parent, FullOrderArguments& arguments);
CLI::App& add_command(CLI::App& parent, SolveArguments& arguments);
CLI::App& add_command(CLI::App& parent, ReproduceArguments& arguments);

}  // namespace knothe

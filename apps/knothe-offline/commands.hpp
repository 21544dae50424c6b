#pragma once
/// @file The commands of `knothe-offline`; `knothe` passes its own command line on to them.
#include <optional>
#include <string>
#include <vector>

namespace knothe::offline_commands {

struct BuildArguments {
  std::string project;
  std::string output;
  std::string method;  ///< overrides the project's
  bool json = false;
};
int build_model(const BuildArguments& arguments);

struct VerifyArguments {
  std::string project;
  std::string model;
  int points = 5;
  unsigned long seed = 1;
  bool json = false;
};
int verify(const VerifyArguments& arguments);

struct MeshStudyArguments {
  std::string project;
  std::vector<double> elements = {0.005, 0.0025, 0.00125};             ///< m
  std::vector<std::string> laws = {"none", "crack-band", "gradient"};  ///< regularisations
  int steps = 0;                                                       ///< 0: the project's
  std::string output;                                                  ///< figure (.svg), none if empty
  bool json = false;
};
/// Load–displacement curves, dissipated energy and crack length of the project's beam on several meshes.
int mesh_study(const MeshStudyArguments& arguments);

struct FullOrderArguments {
  std::string project;
  int refinements = 0;        ///< each cell into 8, so often
  int steps = 0;              ///< 0: the project's
  bool elastic = false;       ///< the elastic solution alone
  double tolerance = 1e-9;    ///< of the linear elastic solution
  int most_iterations = 500;  ///< of conjugate gradients
  std::string output;         ///< field of the last step (.vtu), none if empty
  bool json = false;
};
/// One run of the project's full-order model at its reference parameters, on all ranks of an MPI job.
int full_order(const FullOrderArguments& arguments);

struct SimulateArguments {
  std::string project;
  std::string output;
  std::optional<unsigned long> seed;
  bool images = false;
};
int simulate(const SimulateArguments& arguments);

struct ReproduceArguments {
  bool quick = false;
  bool json = false;
  unsigned long seed = 1;
  std::string output = "reproduction/";
};
int reproduce(const ReproduceArguments& arguments);

}  // namespace knothe::offline_commands

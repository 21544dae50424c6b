#include "knothe/assimilation/population/population.hpp"

#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "apps/guarded_main.hpp"
#include "apps/knothe/command_line.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/files/command_output.hpp"
#include "knothe/record/population_record.hpp"

namespace knothe::commands {
namespace {

struct PopulationArguments {
  std::vector<std::string> results;
  std::vector<std::tuple<std::string, double, double>> mean;  ///< parameter, mean, standard deviation
  std::vector<std::pair<std::string, double>> spread;         ///< parameter, scale
  std::string output;                                         ///< folder; empty: none
  bool json = false;
  unsigned long seed = 1;
};

int population(const PopulationArguments& arguments) {
  assimilation::PopulationOptions options;
  options.seed = arguments.seed;
  for (const auto& [name, mean, std] : arguments.mean) options.priors.mean[name] = {mean, std};
  for (const auto& [name, scale] : arguments.spread) options.priors.spread[name] = scale;
  if (!arguments.output.empty()) files::require_writable_folder(arguments.output);
  std::vector<assimilation::NamedPosterior> posteriors;
  for (const std::string& path : arguments.results) posteriors.push_back(assimilation::read_posterior(path));
  const assimilation::PopulationResult found = assimilation::solve_population(posteriors, options);
  if (!arguments.output.empty()) record::write_population(arguments.output, found);
  const files::CommandOutput output(arguments.json);
  output.line(record::population_record(found), record::population_text(found));
  return exit_status(found.population.trusted);
}

}  // namespace

void add_population(CLI::App& app, Command& chosen) {
  static PopulationArguments arguments;
  CLI::App& command =
      add(app, chosen, arguments, population, "population",
          "Several specimens as one population: its mean and spread, and the prior of the next specimen.",
          "knothe population specimen-1/results specimen-2/results specimen-3/results -o population");
  command.add_option("RESULTS", arguments.results, "folders of results, one for each specimen")->required();
  command
      .add_option(
          "--mean", arguments.mean,
          "NAME MEAN STD: normal prior of the population's mean (of the logarithm, where the specimens' "
          "priors are lognormal); else the widest of their priors")
      ->allow_extra_args(false);
  command
      .add_option("--spread", arguments.spread,
                  "NAME SCALE: half-normal prior of its standard deviation; else that of this prior")
      ->allow_extra_args(false);
  command.add_flag("--json", arguments.json, "one line of JSON on stdout");
  command.add_option("--seed", arguments.seed, "seed of the draws");
  command.add_option("-o,--output", arguments.output,
                     "folder for the result: what `prior = \"posterior\"` of the next specimen takes");
}

}  // namespace knothe::commands

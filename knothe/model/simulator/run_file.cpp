#include "knothe/model/simulator/run_file.hpp"

#include <filesystem>

#include "knothe/base/error.hpp"
#include "knothe/files/atomic_file.hpp"

namespace knothe::model {

void write_run(const Run& run, const Snapshots& solution, const RunRecord& record) {
  files::write_atomically(run.file, [&](const std::string& temporary) {
    files::Hdf5Writer file(temporary);
    write_snapshots(solution, file);
    for (const auto& [name, value] : record.numbers)
      file.write("/record/" + name, {&value, 1}, {1}, {"1", "how the run went"});
    if (const auto& steps = record.steps_without_equilibrium; !steps.empty())
      file.write_integers("/steps_without_equilibrium", std::vector<std::int64_t>(steps.begin(), steps.end()),
                          {steps.size()}, {"1", "step numbers"});
    file.text_attribute("/", "key", run.key);
    file.close();
  });
}

bool is_there(const Run& run) {
  if (!std::filesystem::exists(run.file)) return false;
  try {
    const files::Hdf5Reader file(run.file);
    return file.has("/snapshots") && file.has("/time") && file.text_attribute("/", "key") == run.key;
  } catch (const DataError&) {
    return false;  // computed again and replaced
  }
}

RunRecord read_record(const Run& run) {
  RunRecord record;
  const files::Hdf5Reader file(run.file);
  if (file.has("/record"))
    for (const std::string& name : file.members("/record"))
      record.numbers[name] = file.read("/record/" + name, files::Shape{1})[0];
  if (file.has("/steps_without_equilibrium"))
    for (const std::int64_t step : file.read_integers("/steps_without_equilibrium"))
      record.steps_without_equilibrium.push_back(step);
  return record;
}

FinishedRun read_run(const Run& run) {
  return {read_solution(run.file), read_record(run)};
}

}  // namespace knothe::model

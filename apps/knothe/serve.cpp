/// @file `knothe serve`, and the commands about its journal.
#include <fmt/format.h>

#include <cstdio>

#include "apps/knothe/commands.hpp"
#include "knothe/base/error.hpp"
#include "knothe/project/project_file.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/replay.hpp"
#include "knothe/service/journal/test_journals.hpp"
#include "knothe/service/site/doctor.hpp"
#include "knothe/service/site/service.hpp"

namespace knothe::commands {

int serve(const ServeArguments& arguments) {
  const project::Project project = project::read_project(arguments.project);
  service::ServiceOptions options;
  options.port = arguments.port;
  options.strict_deadline = arguments.strict_deadline;
  options.test = arguments.test;
  if (const std::string objection = service::objection_to_test_name(options.test);
      !options.test.empty() && !objection.empty())
    throw UsageError(fmt::format("--test: {}", objection));
  options.listening = [](const std::string& url) {
    fmt::print("{}\n", url);
    std::fflush(stdout);
  };
  service::serve(project, options);
}

int replay(const JournalArguments& arguments) {
  service::replay_journal(arguments.journal,
                          service::project_of_journal(arguments.journal, arguments.project), arguments.json);
  return 0;
}

int recover(const JournalArguments& arguments) {
  const service::Recovery recovery = service::recover_journal(arguments.journal, arguments.output);
  fmt::print("{} records saved to {}, {} lost\n", recovery.saved, arguments.output, recovery.lost.size());
  for (const std::string& lost : recovery.lost) fmt::print("  {}\n", lost);
  return 0;
}

int backup(const JournalArguments& arguments) {
  const std::string copied = service::backup_journal(arguments.journal, arguments.output);
  fmt::print("{}: {}\n", arguments.output, copied);
  return 0;
}

int export_journal(const JournalArguments& arguments) {
  service::export_journal(
      arguments.journal, service::project_of_journal(arguments.journal, arguments.project), arguments.output);
  return 0;
}

int doctor(const std::string& project, bool sends_alarms) {
  if (sends_alarms && project.empty())
    throw UsageError("--test-alarms needs the project file: its [serve.notify] says where they are sent");
  return service::doctor(".", sibling_installed(), project, sends_alarms) ? 0 : 1;
}

}  // namespace knothe::commands

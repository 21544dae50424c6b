#include "knothe/model/simulator/command_simulator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <optional>

#include "knothe/base/index.hpp"
#include "knothe/base/program.hpp"
#include "knothe/base/sha256.hpp"
#include "knothe/base/text.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/files/atomic_file.hpp"
#include "knothe/model/simulator/run_file.hpp"

namespace knothe::model {
namespace {

namespace fs = std::filesystem;

/// `{{NAME}}` or `{{NAME:FORMAT}}` in a text.
struct Placeholder {
  std::size_t begin = 0, end = 0;
  std::string name, format;
};

bool is_name(const std::string& text) {
  const auto letter = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; };
  return !text.empty() && std::isdigit(static_cast<unsigned char>(text[0])) == 0 &&
         std::all_of(text.begin(), text.end(), letter);
}

/// Anything else in double braces is left to whose file it is.
std::optional<Placeholder> next_placeholder(const std::string& text, std::size_t from) {
  while (true) {
    const std::size_t begin = text.find("{{", from);
    if (begin == std::string::npos) return std::nullopt;
    const std::size_t end = text.find("}}", begin);
    if (end == std::string::npos) return std::nullopt;
    const std::string inside = text.substr(begin + 2, end - begin - 2);
    const std::size_t colon = std::min(inside.find(':'), inside.size());
    const std::string name = inside.substr(0, colon);
    if (is_name(name))
      return Placeholder{begin, end + 2, name, colon < inside.size() ? inside.substr(colon + 1) : ""};
    from = begin + 1;
  }
}

std::string formatted(double value, const std::string& format, const std::string& where) {
  try {
    return fmt::format(fmt::runtime("{:" + format + "}"), value);
  } catch (const fmt::format_error& error) {
    throw ProjectError(
        fmt::format("{}: \"{}\" is no format of a number ({}): e.g. .8e", where, format, error.what()));
  }
}

void require_file(const std::string& path) {
  if (!fs::exists(path))
    throw ProjectError(fmt::format("[offline.command]: there is no file {}: the run needs it", path));
}

std::string make_folder(const fs::path& below) {
  fs::create_directories(below);
  std::string name = (below / "run-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) throw system_error("cannot make a working folder", name);
  return name;
}

void link_into(const std::string& folder, const std::string& path) {
  std::error_code failed;
  const fs::path target = fs::path(folder) / fs::path(path).filename();
  fs::create_symlink(fs::absolute(path), target, failed);
  if (failed) throw IoError(fmt::format("cannot link {} to {}: {}", target.string(), path, failed.message()));
}

/// Everything in `options` that a result depends on.
std::string identity_of(const CommandOptions& options) {
  const auto content = [](const std::string& path) { return to_hex(sha256_of_file(path)); };
  const ResultOptions& result = options.result;
  std::string text = fmt::format("command {} | {} {} {} | {} {} {:a}", fmt::join(options.run, "\x1f"),
                                 result.field, result.quantity, result.outputs, fmt::join(result.names, ","),
                                 fmt::join(result.units, ","), fmt::join(result.times, " "));
  for (const auto* list : {&options.templates, &options.files})
    for (const std::string& path : *list)
      text += fmt::format(" | {} {}", fs::path(path).filename().string(), content(path));
  if (!result.points.empty()) text += " | " + content(result.points);
  return text;
}

}  // namespace

CommandSimulator::CommandSimulator(CommandOptions options, std::vector<Axis> axes, std::string folder)
    : options_(std::move(options)),
      axes_(std::move(axes)),
      folder_(folder.empty() ? fs::temp_directory_path().string() : std::move(folder)) {
  for (const Axis& axis : axes_) names_.push_back(axis.name);
  if (options_.run.empty()) throw ProjectError("[offline.command]: \"run\" is empty: there is no program");
  for (const std::string& path : options_.files) require_file(path);
  std::vector<std::pair<std::string, std::string>> texts;
  for (const std::string& path : options_.templates) {
    require_file(path);
    templates_.push_back(files::read_text(path));
    texts.emplace_back(templates_.back(), path);
  }
  for (const std::string& word : options_.run) texts.emplace_back(word, "offline.command.run");
  const std::vector<double> ones(axes_.size(), 1.0);
  std::vector<bool> used(axes_.size(), false);
  for (const auto& [text, where] : texts) {
    (void)filled(text, where, ones);
    std::size_t at = 0;
    while (const auto found = next_placeholder(text, at)) {
      used[std::find(names_.begin(), names_.end(), found->name) - names_.begin()] = true;
      at = found->end;
    }
  }
  for (Index i = 0; i < std::ssize(used); ++i)
    if (!used[i])
      throw ProjectError(
          fmt::format("[offline.command]: the parameter {0} is in no template and not in "
                      "\"run\": write {{{{{0}}}}} where its value belongs",
                      names_[i]));
  identity_ = identity_of(options_);
}

std::string CommandSimulator::filled(const std::string& text, const std::string& where,
                                     std::span<const double> parameters) const {
  std::string result;
  std::size_t at = 0;
  while (const auto found = next_placeholder(text, at)) {
    const auto name = std::find(names_.begin(), names_.end(), found->name);
    const auto line = 1 + std::count(text.begin(), text.begin() + found->begin, '\n');
    if (name == names_.end())
      throw ProjectError(fmt::format("{}: line {}: {{{{{}}}}} is no parameter{}; [offline.parameters] has {}",
                                     where, line, found->name, did_you_mean(found->name, names_),
                                     fmt::join(names_, ", ")));
    const std::size_t i = name - names_.begin();
    result += text.substr(at, found->begin - at);
    result +=
        formatted(parameters[i] * axes_[i].reference, found->format, fmt::format("{}: line {}", where, line));
    at = found->end;
  }
  return result + text.substr(at);
}

std::string CommandSimulator::key(std::span<const double> parameters) const {
  std::string text = identity_;
  for (Index i = 0; i < std::ssize(axes_); ++i)
    text += fmt::format(" | {} {:a}", axes_[i].name, parameters[i] * axes_[i].reference);
  return text;
}

Snapshots CommandSimulator::attempt(std::span<const double> parameters) const {
  const std::string folder = make_folder(folder_);
  for (const std::string& path : options_.files) link_into(folder, path);
  for (Index i = 0; i < std::ssize(templates_); ++i) {
    const std::string name = fs::path(options_.templates[i]).filename().string();
    files::write_text_atomically(folder + "/" + name,
                                 filled(templates_[i], options_.templates[i], parameters));
  }
  ProgramCall call{{}, folder, folder + "/run.log", options_.time_limit_s, {}};
  for (const std::string& word : options_.run)
    call.words.push_back(filled(word, "offline.command.run", parameters));
  const ProgramEnd end = run_program(call);
  if (end.status != 0) {
    const std::string said = last_lines(call.log);
    throw NumericalError(fmt::format(
        "{} {}{}{} (its folder is kept: {})", call.words.front(),
        end.timed_out ? fmt::format("took longer than the {:g} s of time_limit", options_.time_limit_s)
                      : fmt::format("ended with status {}", end.status),
        said.empty() ? "" : ": ", said, folder));
  }
  Snapshots solution;
  try {
    solution = read_result(options_.result, folder);
    if (!solution.quantities.empty()) solution.field = {"1", "quantities, each in its own unit"};
    solution.axes = axes_;
    for (Index i = 0; i < std::ssize(axes_); ++i) solution.axes[i].nodes = {parameters[i]};
    validate(solution, options_.result.field, 1);
    if (solution.dofs.empty() && solution.quantities.empty())
      throw DataError(options_.result.field + ": its dofs have neither places nor names");
  } catch (const DataError& error) {
    throw DataError(fmt::format("{} (its folder is kept: {})", error.what(), folder));
  }
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  return solution;
}

Snapshots CommandSimulator::solve(std::span<const double> parameters) {
  for (int left = options_.retries; left > 0; --left) {
    try {
      return attempt(parameters);
    } catch (const NumericalError&) {  // once more
    } catch (const DataError&) {
    }
  }
  return attempt(parameters);
}

std::vector<RunFailure> CommandSimulator::solve_to_files(std::span<const Run> runs, int processes,
                                                         const std::function<void(std::size_t)>& finished) {
  std::vector<std::optional<RunFailure>> failed(runs.size());
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(runs.size(), processes, [&](std::size_t i) {
    try {
      write_run(runs[i], solve(runs[i].parameters), {});
    } catch (const NumericalError& error) {
      failed[i] = {i, error.status(), error.what()};
    } catch (const DataError& error) {
      failed[i] = {i, error.status(), error.what()};
    }
    if (failed[i]) return;
    const std::lock_guard lock(mutex);
    finished(++done);
  });
  std::vector<RunFailure> failures;
  for (auto& failure : failed)
    if (failure) failures.push_back(std::move(*failure));
  return failures;
}

}  // namespace knothe::model

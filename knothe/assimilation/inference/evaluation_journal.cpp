#include "knothe/assimilation/inference/evaluation_journal.hpp"

#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "knothe/base/error.hpp"
#include "knothe/files/json_text.hpp"

namespace knothe::assimilation {
namespace {

using Json = nlohmann::json;

constexpr const char* k_kind = "model calls";
constexpr int k_schema_version = 2;
constexpr std::array<const char*, 4> k_names = {"evaluate", "gradient", "jacobian", "hessian"};

std::vector<double> list_of(const Eigen::VectorXd& values) {
  return {values.begin(), values.end()};
}

Eigen::VectorXd vector_of(const Json& list) {
  const auto values = list.get<std::vector<double>>();
  return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
}

ModelCall call_of(const Json& line) {
  const auto name = line.at(0).get<std::string>();
  const auto kind = std::find(k_names.begin(), k_names.end(), name) - k_names.begin();
  if (kind == std::ssize(k_names)) throw DataError("no kind of call");
  return {static_cast<CallKind>(kind), vector_of(line.at(1)), vector_of(line.at(2)), vector_of(line.at(3))};
}

bool answers_as_before(ModelEvaluator& evaluator, const std::vector<ModelCall>& calls) {
  std::vector<const ModelCall*> evaluations;
  for (const ModelCall& call : calls)
    if (call.kind == CallKind::evaluate) evaluations.push_back(&call);
  if (evaluations.empty()) return false;
  const std::array chosen = {evaluations.front(), evaluations[evaluations.size() / 2], evaluations.back()};
  Eigen::MatrixXd points(evaluator.model().dimension(), 3), now;
  for (Eigen::Index i = 0; i < 3; ++i) points.col(i) = chosen[i]->point;
  evaluator.evaluate(points, now);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const Eigen::VectorXd& before = chosen[i]->answer;
    if (!((now.col(i) - before).cwiseAbs().maxCoeff() <= 1e-9 * before.cwiseAbs().maxCoeff())) return false;
  }
  return true;
}

}  // namespace

EvaluationJournal::EvaluationJournal(std::string path, std::string identity)
    : path_(std::move(path)), identity_(std::move(identity)) {}

void EvaluationJournal::read(ModelEvaluator& evaluator, std::vector<ModelCall>& calls,
                             std::string& refused) const {
  std::ifstream file(path_);
  std::string line;
  std::getline(file, line);
  Json head;
  try {
    head = files::parse_json(line);
  } catch (const DataError&) {  // not an object, then
  }
  if (!head.is_object() || head.value("kind", "") != k_kind ||
      head.value("schema_version", 0) != k_schema_version) {
    refused = "it is no such file";
    return;
  }
  if (head.value("identity", "") != identity_) {
    refused = "they are of another model or another configuration";
    return;
  }
  while (std::getline(file, line) && !file.eof()) {  // without its line end the last one may be torn
    try {
      ModelCall call = call_of(files::parse_json(line));
      if (evaluator.fits(call)) calls.push_back(std::move(call));
    } catch (const std::exception&) {
      break;
    }
  }
  if (calls.empty() || answers_as_before(evaluator, calls)) return;
  refused = "the model answers otherwise now";
  calls.clear();
}

KeptCalls EvaluationJournal::open(ModelEvaluator& evaluator) {
  KeptCalls out;
  std::vector<ModelCall> calls;
  std::error_code none;
  if (std::filesystem::exists(path_, none)) read(evaluator, calls, out.refused);
  // What was taken is written again beside the old file: a torn line is left behind, and nothing is lost.
  const std::string fresh = path_ + ".new";
  file_.open(fresh, std::ios::trunc);
  file_ << Json{{"kind", k_kind}, {"schema_version", k_schema_version}, {"identity", identity_}}.dump()
        << '\n';
  for (const ModelCall& call : calls) {
    evaluator.remember(call);
    write(call);
  }
  file_.flush();
  if (!file_) throw system_error("writing", fresh);
  std::filesystem::rename(fresh, path_, none);
  if (none) throw IoError(fmt::format("cannot rename {} to {}: {}", fresh, path_, none.message()));
  out.taken = calls_;
  evaluator.answered = [this](const ModelCall& call) {
    write(call);
    if (!file_.flush()) throw system_error("writing", path_);
  };
  return out;
}

void EvaluationJournal::write(const ModelCall& call) {
  file_ << Json{k_names[static_cast<std::size_t>(call.kind)], list_of(call.point), list_of(call.sensitivity),
                list_of(call.answer)}
               .dump()
        << '\n';
  ++calls_;
}

void EvaluationJournal::remove() {
  file_.close();
  std::error_code none;
  std::filesystem::remove(path_, none);
}

}  // namespace knothe::assimilation

#include <nlohmann/json.hpp>

#include "knothe/base/version.hpp"
#include "knothe/record/fields.hpp"
#include "knothe/service/net/api.hpp"

namespace knothe::service {
namespace {

Json text(const char* description) {
  return {{"description", description},
          {"content", {{"application/json", {{"schema", {{"$ref", "#/components/schemas/Error"}}}}}}}};
}

Json ok(const Json& schema, const char* type = "application/json") {
  return {{"description", "as docs/reference/service.md says"}, {"content", {{type, {{"schema", schema}}}}}};
}

Json parameter(const char* name, const char* type, const char* meaning) {
  return {{"name", name},
          {"in", "query"},
          {"required", false},
          {"description", meaning},
          {"schema", {{"type", type}}}};
}

Json object_of(std::initializer_list<std::pair<const char*, Json>> members, const Json& required) {
  Json properties = Json::object();
  for (const auto& [name, schema] : members) properties[name] = schema;
  return {{"type", "object"}, {"properties", properties}, {"required", required}};
}

Json get(const char* summary, const Json& schema, std::initializer_list<Json> parameters = {},
         const char* type = "application/json") {
  Json all = Json::array();
  for (const Json& p : parameters) all.push_back(p);
  all.push_back(parameter("site", "string", "name of the site; the first without it"));
  return {{"get",
           {{"summary", summary},
            {"parameters", all},
            {"responses",
             {{"200", ok(schema, type)},
              {"400", text("malformed")},
              {"401", text("token needed")},
              {"404", text("not there")}}}}}};
}

Json post(const char* summary, const Json& body, const Json& answer) {
  return {{"summary", summary},
          {"requestBody", {{"required", true}, {"content", body}}},
          {"responses",
           {{"200", ok(answer)},
            {"400", text("malformed")},
            {"401", text("token needed")},
            {"404", text("not there")},
            {"409", text("the same key with another payload")},
            {"411", text("no length of the body")},
            {"413", text("too large")},
            {"415", text("another content type")},
            {"503", text("not ready")},
            {"507", text("disk full")}}}};
}

}  // namespace

std::string openapi_document() {
  const Json number = {{"type", "number"}}, integer = {{"type", "integer"}}, words = {{"type", "string"}},
             boolean = {{"type", "boolean"}};
  const Json numbers = {{"type", "array"}, {"items", number}}, rows = {{"type", "array"}, {"items", numbers}};
  const Json any = {{"type", "object"}};
  const Json schemas = record::line_schemas();
  const Json level = schemas["verdict"]["properties"]["level"];
  Json line = schemas["step"];
  line["properties"].update(
      {{"site", words}, {"event", integer}, {"data", integer}, {"received_at", number}});
  for (const char* key : {"site", "event", "data"}) line["required"].push_back(key);
  const Json datum = object_of({{"site", words},
                                {"source", words},
                                {"session", words},
                                {"seq", {{"type", "integer"}, {"minimum", 0}}},
                                {"time", number},
                                {"values", {{"type", "array"}, {"items", {{"type", {"number", "null"}}}}}},
                                {"status", {{"type", "array"}, {"items", words}}},
                                {"series",
                                 {{"type", "object"},
                                  {"additionalProperties", {{"type", {"number", "null"}}}},
                                  {"description", "in place of values: those of series by name"}}},
                                {"test", words}},
                               {"source", "session", "seq", "time"});
  const Json stored = object_of({{"accepted", boolean},
                                 {"duplicate", boolean},
                                 {"step", integer},
                                 {"record", integer},
                                 {"quarantined", boolean},
                                 {"reason", words},
                                 {"replacement", boolean}},
                                {"accepted", "duplicate", "step"});
  const Json key = object_of({{"site", words},
                              {"source", words},
                              {"session", words},
                              {"seq", integer},
                              {"record", integer},
                              {"by", words},
                              {"comment", words}},
                             {"source", "session", "seq"});
  const Json held = object_of({{"source", words},
                               {"session", words},
                               {"seq", integer},
                               {"time", number},
                               {"step", integer},
                               {"reason", words}},
                              {"source", "session", "seq", "time", "step", "reason"});
  const Json entry = object_of({{"number", integer},
                                {"kind", {{"type", "string"}, {"enum", words_of<EntryKind>()}}},
                                {"time", number},
                                {"by", words},
                                {"text", words},
                                {"written_at", number},
                                {"alarm", integer},
                                {"sensor", integer},
                                {"record", integer},
                                {"version", integer},
                                {"full_order_runs", integer},
                                {"moved_std", number},
                                {"model", words},
                                {"name", words},
                                {"journal", words}},
                               {"number", "kind", "time", "by", "text", "written_at"});
  const Json error = object_of(
      {{"error", object_of({{"type", words}, {"message", words}}, {"type", "message"})}}, {"error"});
  const Json line_reference = {{"$ref", "#/components/schemas/Line"}};
  const Json step = parameter("step", "integer", "step; the latest without it");
  Json paths = {
      {"/livez", get("alive", words, {}, "text/plain")},
      {"/readyz", get("ready to take measurements", any)},
      {"/metrics", get("Prometheus metrics", words, {}, "text/plain")},
      {"/v1/state", get("line of the latest step", line_reference)},
      {"/v1/states", get("lines of all steps from one on", {{"type", "array"}, {"items", line_reference}},
                         {parameter("from", "integer", "first step"),
                          parameter("test", "string", "name of an earlier test")})},
      {"/v1/events", get("lines, states and alarms as server-sent events", words,
                         {parameter("from", "integer", "first step"),
                          parameter("last_event_id", "integer", "as the header Last-Event-ID")},
                         "text/event-stream")},
      {"/v1/status",
       get("state of the service, and of the structure",
           object_of({{"state", words}, {"reason", words}, {"structure", level}}, {"state", "reason"}))},
      {"/v1/sites",
       get("names of the sites", object_of({{"sites", {{"type", "array"}, {"items", words}}}}, {"sites"}))},
      {"/v1/description", get("what the page needs once", any)},
      {"/v1/mesh", get("mesh and sensors", any)},
      {"/v1/field", get("a field at the posterior mean", any,
                        {parameter("name", "string", "displacement, sensitivity, residual or bias"), step,
                         parameter("parameter", "string", "of a sensitivity")})},
      {"/v1/picture", get("the picture that a step was measured in",
                          {{"type", "string"}, {"format", "binary"}}, {step}, "image/png")},
      {"/v1/observations", get("sensors of a step", any, {step})},
      {"/v1/samples", get("draws of the posterior", any, {step})},
      {"/v1/signal", get("what a sensor measured, and the posterior's prediction", any,
                         {parameter("sensor", "string", "index, or name of a series"), step})},
      {"/v1/alarms", get("the last alarms", any)},
      {"/v1/logbook", get("acknowledgements, sensors switched off, notes",
                          object_of({{"logbook", {{"type", "array"}, {"items", entry}}}}, {"logbook"}))},
      {"/v1/quarantine",
       get("data that came too late, or have a value beyond its limit",
           object_of({{"quarantined", {{"type", "array"}, {"items", held}}}}, {"quarantined"}))}};
  const Json key_body = {{"application/json", {{"schema", key}}}};
  paths["/v1/quarantine"]["post"] = post("assimilate a quarantined datum", key_body, stored);
  paths["/v1/withdraw"]["post"] =
      post("take a datum out, as if it had never come", key_body,
           object_of({{"withdrawn", boolean}, {"step", integer}}, {"withdrawn", "step"}));
  const auto body_of = [](const Json& schema) { return Json{{"application/json", {{"schema", schema}}}}; };
  paths["/v1/alarms/{id}/acknowledge"]["post"] =
      post("acknowledge an alarm",
           body_of(object_of({{"site", words}, {"by", words}, {"comment", words}}, {"by"})), entry);
  paths["/v1/alarms/{id}/acknowledge"]["parameters"] =
      Json::array({{{"name", "id"}, {"in", "path"}, {"required", true}, {"schema", {{"type", "integer"}}}}});
  paths["/v1/notes"]["post"] =
      post("write a note",
           body_of(object_of({{"site", words}, {"step", integer}, {"by", words}, {"text", words}},
                             {"by", "text"})),
           entry);
  paths["/v1/sensors"]["post"] = post("switch a sensor off, or on again, from a step on",
                                      body_of(object_of({{"site", words},
                                                         {"sensor", {{"type", {"integer", "string"}}}},
                                                         {"active", boolean},
                                                         {"step", integer},
                                                         {"by", words},
                                                         {"comment", words}},
                                                        {"sensor", "active", "by"})),
                                      entry);
  const Json signed_comment = object_of({{"site", words}, {"by", words}, {"comment", words}}, {"by"});
  paths["/v1/verify"]["post"] =
      post("ask the full-order model at the latest posterior", body_of(signed_comment), entry);
  paths["/v1/tests"] = get("tests of this structure", any);
  const Json named = object_of({{"site", words}, {"name", words}, {"by", words}, {"comment", words}}, {"by"});
  paths["/v1/tests"]["post"] =
      post("begin another test, with a journal of its own; the one that runs is finished",
           body_of(object_of({{"site", words}, {"name", words}, {"by", words}, {"comment", words}},
                             {"name", "by"})),
           entry);
  paths["/v1/tests/finish"]["post"] =
      post("finish the test: no more data are taken", body_of(signed_comment), entry);
  paths["/v1/tests/resume"]["post"] =
      post("take that back, or go back to an earlier test", body_of(named), entry);
  paths["/v1/measurements"]["post"] =
      post("take a measurement; 200 when it is on disk",
           {{"application/json", {{"schema", {{"$ref", "#/components/schemas/Measurement"}}}}},
            {"application/x-npy", {{"schema", {{"type", "string"}, {"format", "binary"}}}}}},
           stored);
  paths["/Info"] = get("UM-Bridge", any);
  for (const char* route : {"/ModelInfo", "/InputSizes", "/OutputSizes", "/Evaluate", "/Gradient",
                            "/ApplyJacobian", "/ApplyHessian"})
    paths[route]["post"] = post("UM-Bridge", {{"application/json", {{"schema", any}}}}, any);
  Json document = {{"openapi", "3.1.0"},
                   {"info",
                    {{"title", "knothe serve"},
                     {"version", k_version},
                     {"summary", "Measurements in, posterior and forecast out."}}},
                   {"paths", paths},
                   {"components",
                    {{"schemas", {{"Line", line}, {"Measurement", datum}, {"Error", error}}},
                     {"securitySchemes", {{"token", {{"type", "http"}, {"scheme", "bearer"}}}}}}}};
  return document.dump();
}

}  // namespace knothe::service

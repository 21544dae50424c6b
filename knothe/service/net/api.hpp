#pragma once
/// @file The routes of the service (docs/reference/service.md). Private to this room.
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "knothe/service/net/http_server.hpp"
#include "knothe/service/net/tokens.hpp"
#include "knothe/service/net/umbridge.hpp"
#include "knothe/service/site/served_site.hpp"
#include "knothe/service/site/test_lines.hpp"
#include "knothe/service/site/worker.hpp"

namespace knothe::service {

struct ApiOptions {
  bool loopback = true;  ///< listens where this machine alone can reach it
  Tokens tokens;
  bool strict_deadline = false;
};

class Api final : public HttpHandler {
 public:
  Api(std::vector<std::shared_ptr<ServedSite>> sites, ApiOptions options, Metrics& metrics);

  Admission admit(const HttpRequest& head, HttpResponse& refusal) override;
  void handle(HttpRequest request, Answer answer) override;
  std::unique_ptr<EventSource> events(const HttpRequest& request) override;
  /// Threads that hang, in words; empty: none.
  [[nodiscard]] std::string complaint() const;
  /// Of the threads that are of no one test.
  [[nodiscard]] Pulses& pulses() { return pulses_; }
  bool tick() override;
  /// Answers what is waiting; nothing is asked afterwards.
  void finish() {
    worker_.reset();
    ingest_worker_.reset();
    test_lines_.stop();
    slow_worker_.reset();
  }

 private:
  void route(const HttpRequest& request, const Answer& answer);
  [[nodiscard]] std::unique_ptr<EventSource> make_events(const HttpRequest& request) const;
  HttpResponse read(const HttpRequest& request);
  HttpResponse states_of_test(const HttpRequest& request);
  static void later(Worker& worker, const Answer& answer, std::function<void()> what);
  void handle_post(const HttpRequest& request, const Answer& answer);
  void handle_measurement(const HttpRequest& request, const Answer& answer);
  void handle_release(const HttpRequest& request, const Answer& answer);
  void handle_withdrawal(const HttpRequest& request, const Answer& answer);
  void handle_entry(const HttpRequest& request, const Answer& answer);
  [[nodiscard]] HttpResponse ready() const;
  void handle_test(const HttpRequest& request, const Answer& answer);
  /// Whose token came with a request that acts; empty: a shared one, or none.
  [[nodiscard]] std::string holder(const HttpRequest& request) const {
    return options_.tokens.holder(request, true).value_or("");
  }
  [[nodiscard]] std::shared_ptr<ServedSite> served(const std::string& name) const;
  [[nodiscard]] std::shared_ptr<Site> site_of(const std::string& name) const {
    return served(name)->current();
  }
  [[nodiscard]] std::vector<std::string> site_names() const;

  std::vector<std::shared_ptr<ServedSite>> sites_;
  ApiOptions options_;
  Metrics& metrics_;
  UmBridge umbridge_;     ///< of the worker
  TestLines test_lines_;  ///< of the worker for what takes minutes
  Pulses pulses_;
  /// Last: what they do uses the others. The second is for data alone: no reader's question holds them up.
  /// The third computes what nobody waits for in time: other tests from their journals.
  std::unique_ptr<Worker> worker_ = std::make_unique<Worker>(), ingest_worker_ = std::make_unique<Worker>(),
                          slow_worker_ = std::make_unique<Worker>();
};

/// The OpenAPI 3.1 document of the routes.
[[nodiscard]] std::string openapi_document();

/// The page that was there when the program was built, or a short one that says that there was none.
[[nodiscard]] std::string_view page();

}  // namespace knothe::service

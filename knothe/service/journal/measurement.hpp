#pragma once
/// @file A measurement as it is sent: its key, its payload, and its parsing from JSON and npy.
#include <cstdint>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "knothe/likelihood/data/datum.hpp"
#include "knothe/model/observe/sensors.hpp"

namespace knothe::service {

/// One vector of values of all sensors at one model time, as it was sent.
struct Measurement {
  likelihood::DatumKey key;
  double time = 0;
  std::vector<double> values;        ///< as sent; NaN for null
  std::vector<std::uint8_t> status;  ///< one per value: 0 is good, anything else is missing
  std::string noise;                 ///< its own (noise_bytes.hpp); empty: that of the sensors
  std::int64_t step = 0;             ///< index of the model time
  std::int64_t received_ms = 0;      ///< Unix time of its arrival; nothing depends on it
  /// Whether it takes the place of a datum of its key that was withdrawn. From a watched folder, or a broker
  /// that has kept it, it comes again by itself; a broker also repeats what it has no receipt for.
  enum class Restores { always, if_changed, never } restores = Restores::always;
  /// As sent in place of `values`: those of series by name, all else missing. Empty once the site, which
  /// knows its sensors, has made values of them (`set_values_of_series`).
  std::map<std::string, double> series;

  /// RequestError 400 for a name that is none of the sensors'.
  void set_values_of_series(const model::Sensors& sensors);
  /// The values that the engine sees: NaN where missing.
  [[nodiscard]] std::vector<double> effective_values() const;
  /// As the engine takes it: every model time is a step. DataError for noise that is damaged.
  [[nodiscard]] likelihood::Datum datum() const;
  /// Values and status as the journal keeps them: count, doubles, bytes, little endian.
  [[nodiscard]] std::string payload() const;
  /// Back again. False if the bytes are not a payload.
  [[nodiscard]] bool set_payload(std::string_view bytes);
};

/// What is wrong with a request: an HTTP status, a type for programs and a message for people. Not an Error
/// of the program: it never leaves the service but as an answer.
class RequestError : public std::runtime_error {
 public:
  RequestError(int status, std::string type, const std::string& message)
      : std::runtime_error(message), status_(status), type_(std::move(type)) {}
  [[nodiscard]] int status() const { return status_; }
  [[nodiscard]] const std::string& type() const { return type_; }

 private:
  int status_;
  std::string type_;
};

/// A measurement, the site it is for (may be empty), and the test, if it says so.
struct SiteMeasurement {
  std::string site;
  std::optional<std::string> test;  ///< name; empty: the test without one
  Measurement measurement;
};

/// From the JSON object of `POST /v1/measurements`. RequestError 400 that says which member is wrong.
[[nodiscard]] SiteMeasurement parse_json_measurement(std::string_view body);

/// A datum that is there already. Its key may have had several records: each but the last is withdrawn.
struct RecordName {
  enum class Which {
    last,
    first,  ///< a request that is kept somewhere, and comes again, is of the first: it was made then
    numbered
  };
  likelihood::DatumKey key;
  Which which = Which::last;
  std::int64_t number = 0;  ///< in the journal
};

/// Who asks for something, and why. An empty name: nobody says.
struct Signature {
  std::string author, text;
};

/// A datum's name, the site it is at (may be empty), and who asks.
struct SiteKey {
  std::string site;
  RecordName datum;
  Signature signature = {};
};

/// From a JSON object with `source`, `session`, `seq`, the number of its `record` if that is known, and `by`
/// and `comment` if it is signed. `holder`: whose token came with it; empty: a shared one. RequestError 400
/// that says which member is wrong, 403 where `by` is another than the holder.
[[nodiscard]] SiteKey parse_json_key(std::string_view body, const std::string& holder = {});

/// From an MQTT message: topic knothe/v1/SITE/SOURCE/data, payload the same JSON, whose `site` (may be left
/// out) and `source` must be those of the topic. RequestError 400.
[[nodiscard]] SiteMeasurement parse_mqtt_measurement(std::string_view topic, std::string_view payload);
/// The same of a datum to be withdrawn: topic knothe/v1/SITE/SOURCE/withdraw.
[[nodiscard]] SiteKey parse_mqtt_key(std::string_view topic, std::string_view payload);

/// The key and time of a datum whose values come as npy: texts of HTTP headers.
struct NpyHeaders {
  std::string site, source, session, seq, time, status;
  std::string test = {};  ///< empty: it does not say
};
[[nodiscard]] SiteMeasurement parse_npy_measurement(std::string_view body, const NpyHeaders& headers);

/// The numbers of a one-dimensional .npy array of little- or big-endian float32 or float64. RequestError 400.
[[nodiscard]] std::vector<double> parse_npy(std::string_view bytes);

}  // namespace knothe::service

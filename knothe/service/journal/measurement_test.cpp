#include "knothe/service/journal/measurement.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "knothe/base/sha256.hpp"
#include "knothe/service/net/tokens.hpp"

namespace knothe::service {
namespace {

const std::string k_json =
    R"({"site":"beam","source":"camera","session":"s","seq":4,"time":0.25,"values":[1.5,null,-3e-7],"status":["good","good","bad"]})";

std::string npy(const std::string& type, const std::string& shape, const std::string& data, int version = 1) {
  std::string header = "{'descr': '" + type + "', 'fortran_order': False, 'shape': " + shape + ", }";
  header.resize(118 - 10, ' ');
  header += '\n';
  std::string out("\x93NUMPY", 6);
  out += static_cast<char>(version);
  out += '\0';
  out += static_cast<char>(header.size() & 255);
  out += static_cast<char>(header.size() >> 8);
  if (version > 1) out += std::string(2, '\0');
  return out + header + data;
}

template <class Number>
std::string bytes_of(const std::vector<Number>& numbers, bool swapped = false) {
  std::string out;
  for (const Number number : numbers) {
    std::string one(reinterpret_cast<const char*>(&number), sizeof number);
    out += swapped ? std::string(one.rbegin(), one.rend()) : one;
  }
  return out;
}

std::string refusal(const std::string& body) {
  try {
    (void)parse_json_measurement(body);
  } catch (const RequestError& error) {
    EXPECT_EQ(error.status(), 400);
    EXPECT_EQ(error.type(), "Malformed");
    return error.what();
  }
  return "";
}

TEST(Measurement, IsReadFromJson) {
  const SiteMeasurement read = parse_json_measurement(k_json);
  EXPECT_EQ(read.site, "beam");
  EXPECT_EQ(read.measurement.key, (likelihood::DatumKey{"camera", "s", 4}));
  EXPECT_EQ(read.measurement.time, 0.25);
  const auto values = read.measurement.effective_values();
  ASSERT_EQ(values.size(), 3u);
  EXPECT_EQ(values[0], 1.5);
  EXPECT_TRUE(std::isnan(values[1]));
  EXPECT_TRUE(std::isnan(values[2]));
  EXPECT_EQ(read.measurement.values[2], -3e-7);
}

TEST(Measurement, AKeyIsReadFromJson) {
  const SiteKey datum = parse_json_key(R"({"site":"beam","source":"camera","session":"s","seq":7})");
  EXPECT_EQ(datum.site, "beam");
  EXPECT_EQ(datum.datum.key, (likelihood::DatumKey{"camera", "s", 7}));
  EXPECT_EQ(datum.datum.which, RecordName::Which::last);
  const SiteKey numbered = parse_json_key(R"({"source":"camera","session":"s","seq":7,"record":12})");
  EXPECT_EQ(numbered.datum.which, RecordName::Which::numbered);
  EXPECT_EQ(numbered.datum.number, 12);
  for (const char* wrong :
       {"", "[]", R"({"source":"camera","session":"s"})", R"({"source":"camera","session":"s","seq":1.5})",
        R"({"source":1,"session":"s","seq":1})"})
    EXPECT_THROW((void)parse_json_key(wrong), RequestError) << wrong;
}

/// What is left out without a word must not be what was meant.
TEST(Measurement, ASlipInAKeyThatMayBeLeftOutIsRefused) {
  const std::string datum = R"({"source":"camera","session":"s","seq":4,"time":0.25,"values":[1.5],)";
  for (const char* slip : {"Status", "staus", "statuses"})
    EXPECT_EQ(
        refusal(datum + "\"" + slip + R"(":["bad"]})"),
        "\"" + std::string(slip) + "\" is no key of this request: write \"status\", or give it another name");
  EXPECT_EQ(refusal(datum + R"("operator":"x","state":"cold"})"), "");
  EXPECT_THROW((void)parse_json_key(R"({"source":"camera","session":"s","seq":7,"records":12})"),
               RequestError);
}

TEST(Measurement, APayloadComesBackToTheBit) {
  const Measurement datum = parse_json_measurement(k_json).measurement;
  Measurement back;
  ASSERT_TRUE(back.set_payload(datum.payload()));
  EXPECT_EQ(back.payload(), datum.payload());
  EXPECT_EQ(back.status, datum.status);
  for (std::size_t n = 0; n < datum.payload().size(); ++n)
    EXPECT_FALSE(back.set_payload(datum.payload().substr(0, n)));
  EXPECT_FALSE(back.set_payload(std::string(8, '\xff')));
}

TEST(Measurement, WhatIsWrongIsNamed) {
  const auto replaced = [](const std::string& old, const std::string& by) {
    std::string text = k_json;
    return text.replace(text.find(old), old.size(), by);
  };
  EXPECT_NE(refusal("").find("not JSON"), std::string::npos);
  EXPECT_NE(refusal("[1]").find("one JSON object"), std::string::npos);
  EXPECT_NE(refusal(R"({"source":"a"})").find("\"session\" is missing"), std::string::npos);
  EXPECT_NE(refusal(replaced("\"camera\"", "\"\"")).find("must not be empty"), std::string::npos);
  EXPECT_NE(refusal(replaced("\"camera\"", "\"a\\u0007\"")).find("control character"), std::string::npos);
  EXPECT_NE(refusal(replaced("\"camera\"", "\"" + std::string(200, 'x') + "\"")).find("longer than 128"),
            std::string::npos);
  EXPECT_NE(refusal(replaced("4", "-1")).find("\"seq\""), std::string::npos);
  EXPECT_NE(refusal(replaced("4", "4.5")).find("\"seq\""), std::string::npos);
  EXPECT_NE(refusal(replaced("4", "18446744073709551615")).find("\"seq\""), std::string::npos);
  EXPECT_NE(refusal(replaced("0.25", "\"now\"")).find("\"time\""), std::string::npos);
  EXPECT_NE(refusal(replaced("0.25", "1e999")).find("not JSON"), std::string::npos);
  EXPECT_NE(refusal(replaced("1.5", "\"x\"")).find("values[0]"), std::string::npos);
  EXPECT_NE(refusal(replaced("1.5", "NaN")).find("not JSON"), std::string::npos);
  EXPECT_NE(refusal(replaced("[\"good\",", "[")).find("2 entries for 3 values"), std::string::npos);
  EXPECT_NE(refusal(std::string(100000, '[')).find("not JSON"), std::string::npos);
}

TEST(Measurement, NpyArraysOfEitherOrderAndWidthAreRead) {
  const std::vector<double> doubles = {1.5, -2e-7, 3};
  const std::vector<float> floats = {1.5f, -2e-7f, 3.0f};
  EXPECT_EQ(parse_npy(npy("<f8", "(3,)", bytes_of(doubles))), doubles);
  EXPECT_EQ(parse_npy(npy(">f8", "(3,)", bytes_of(doubles, true))), doubles);
  EXPECT_EQ(parse_npy(npy("<f8", "(3,)", bytes_of(doubles), 2)), doubles);
  EXPECT_EQ(parse_npy(npy("<f4", "(3,)", bytes_of(floats))),
            std::vector<double>(floats.begin(), floats.end()));
  EXPECT_EQ(parse_npy(npy(">f4", "(3,)", bytes_of(floats, true))),
            std::vector<double>(floats.begin(), floats.end()));
  for (const auto& wrong :
       {npy("<i8", "(3,)", bytes_of(doubles)), npy("<f8", "(4,)", bytes_of(doubles)),
        npy("<f8", "(3, 1)", bytes_of(doubles)), npy("<f8", "(99999999999999999999,)", ""),
        npy("<f8", "(2305843009213693952,)", ""), std::string("no npy")})
    EXPECT_THROW((void)parse_npy(wrong), RequestError);
}

/// Every parser takes every mutilation of a good input: it reads it, or refuses it by RequestError.
TEST(Measurement, MutilatedInputIsReadOrRefused) {
  std::mt19937_64 random(3);
  const std::string array = npy("<f8", "(3,)", bytes_of(std::vector<double>{1, 2, 3}));
  int refused = 0;
  for (int k = 0; k < 20000; ++k) {
    std::string text = k % 2 == 0 ? k_json : array;
    for (int change = 0; change < 1 + k % 4; ++change) {
      const std::size_t at = random() % text.size();
      switch (random() % 4) {
        case 0:
          text[at] = static_cast<char>(random());
          break;
        case 1:
          text.erase(at, 1 + random() % 8);
          break;
        case 2:
          text.insert(at, text.substr(random() % text.size(), random() % 16));
          break;
        default:
          text.resize(at + 1);
      }
      if (text.empty()) text = "x";
    }
    try {
      if (k % 2 == 0) {
        (void)parse_json_measurement(text).measurement.payload();
      } else {
        (void)parse_npy_measurement(text, {"", "a", "b", "1", "0.5", ""});
      }
    } catch (const RequestError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 10000);
}

TEST(Sha256, AgreesWithTheStandardsExamples) {
  EXPECT_EQ(to_hex(sha256_of("")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(to_hex(sha256_of("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(to_hex(sha256_of("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq")),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  Sha256 pieces;
  for (int i = 0; i < 1000; ++i) pieces.add(std::string(1000, 'a'));
  EXPECT_EQ(to_hex(pieces.finish()), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Token, ComparisonIsExact) {
  EXPECT_TRUE(equal_in_constant_time("secret", "secret"));
  EXPECT_FALSE(equal_in_constant_time("secret", "secreT"));
  EXPECT_FALSE(equal_in_constant_time("secret", "secretsecret"));
  EXPECT_FALSE(equal_in_constant_time("secretsecret", "secret"));
  EXPECT_FALSE(equal_in_constant_time("x", ""));
}

TEST(Measurement, MayNameItsTest) {
  const auto test_of = [](const std::string& member) {
    return parse_json_measurement(R"({"source":"a","session":"b","seq":0,"time":1,"values":[1])" + member +
                                  "}")
        .test;
  };
  EXPECT_EQ(test_of(""), std::nullopt);
  EXPECT_EQ(test_of(R"(,"test":"")"), "");
  EXPECT_EQ(test_of(R"(,"test":"second")"), "second");
  EXPECT_THROW((void)test_of(R"(,"test":null)"), RequestError);
  const std::string body = npy("<f8", "(1,)", bytes_of<double>({1}));
  EXPECT_EQ(parse_npy_measurement(body, {"", "a", "b", "0", "1", ""}).test, std::nullopt);
  EXPECT_EQ(parse_npy_measurement(body, {"", "a", "b", "0", "1", "", "second"}).test, "second");
}

TEST(Measurement, ANameOfAHeaderIsUtf8) {
  const std::string body = npy("<f8", "(1,)", bytes_of<double>({1}));
  EXPECT_EQ(parse_npy_measurement(body, {"", "Brücke", "s", "0", "0.5", ""}).measurement.key.source,
            "Brücke");
  for (const char* name : {"\xff", "a\xc3", "\xed\xa0\x80", "\xc0\xaf"}) {
    try {
      (void)parse_npy_measurement(body, {"", "camera", name, "0", "0.5", ""});
      FAIL() << name;
    } catch (const RequestError& error) {
      EXPECT_STREQ(error.what(), "\"session\" is not UTF-8");
    }
  }
}

}  // namespace
}  // namespace knothe::service

/// @file Index sets against brute-force enumeration.
#include "knothe/posterior/map/parametrisation.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <set>

#include "knothe/base/error.hpp"

namespace knothe::posterior {
namespace {

using Degrees = std::vector<int>;

/// All degrees in [0, limit]^variables for which `allowed`.
std::set<Degrees> enumerate(int variables, int limit, const std::function<bool(const Degrees&)>& allowed) {
  std::set<Degrees> found;
  Degrees alpha(static_cast<std::size_t>(variables), 0);
  while (true) {
    if (allowed(alpha)) found.insert(alpha);
    std::size_t i = 0;
    while (i < alpha.size() && ++alpha[i] > limit) alpha[i++] = 0;
    if (i == alpha.size()) return found;
  }
}

/// The same set as degrees; every index must occur once, with its sum, sums increasing.
std::set<Degrees> degrees_of(const std::vector<MultiIndex>& set, int variables) {
  std::set<Degrees> result;
  int last = 0;
  for (const MultiIndex& index : set) {
    Degrees alpha;
    int sum = 0;
    for (int v = 0; v < variables; ++v) sum += (alpha.push_back(index.degree_of(v)), alpha.back());
    EXPECT_EQ(index.total, sum);
    EXPECT_GE(sum, last);
    last = sum;
    EXPECT_TRUE(result.insert(alpha).second);
  }
  return result;
}

TEST(MultiIndexSets, AgreeWithEnumeration) {
  for (int variables : {1, 2, 3, 4})
    for (int order : {0, 1, 2, 5}) {
      EXPECT_EQ(degrees_of(total_order_indices(variables, order), variables),
                enumerate(variables, order, [&](const Degrees& a) {
                  int sum = 0;
                  for (int degree : a) sum += degree;
                  return sum <= order;
                }));
    }
  for (const Degrees& orders : {Degrees{3}, Degrees{2, 5}, Degrees{6, 0, 3}, Degrees{1, 3, 3, 2}}) {
    const int variables = static_cast<int>(orders.size());
    EXPECT_EQ(degrees_of(anisotropic_indices(orders), variables),
              enumerate(variables, 6, [&](const Degrees& a) {
                int sum = 0;  // in sixths and thirtieths: whole numbers
                for (std::size_t i = 0; i < a.size(); ++i) {
                  if (orders[i] == 0 && a[i] > 0) return false;
                  if (orders[i] > 0) sum += a[i] * 30 / orders[i];
                }
                return sum <= 30;
              }));
  }
}

TEST(MultiIndexSets, RestrictedToSomeVariables) {
  const Degrees allowed{0, 2};
  EXPECT_EQ(degrees_of(restricted_to(total_order_indices(3, 3), allowed), 3),
            enumerate(3, 3, [](const Degrees& a) { return a[1] == 0 && a[0] + a[2] <= 3; }));
}

TEST(MapSpecification, MakersAgreeAndCount) {
  const MapSpecification total = total_order_map(3, 4);
  EXPECT_EQ(total.dimension(), 3);
  EXPECT_EQ(total.order(), 4);
  EXPECT_EQ(total.coefficient_count(), 1 + 5 + 15 + 4 + 10 + 20);
  const Degrees orders{4, 4, 4};
  const MapSpecification same = per_variable_map(orders);
  for (std::size_t k = 0; k < 3; ++k) {
    const int v = static_cast<int>(k) + 1;
    EXPECT_EQ(degrees_of(same.components[k].constant, v), degrees_of(total.components[k].constant, v));
    EXPECT_EQ(degrees_of(same.components[k].monotone, v), degrees_of(total.components[k].monotone, v));
  }
  const MapSpecification sparse = sparse_map(total, {{}, {}, {1}});
  EXPECT_EQ(sparse.components[1].constant.size(), 1u);
  EXPECT_EQ(sparse.components[1].monotone.size(), 4u);   // x_1 alone
  EXPECT_EQ(sparse.components[2].monotone.size(), 10u);  // x_1 and x_2
}

/// The message with which `body` throws a UsageError.
template <class Body>
std::string message_of(const Body& body) {
  try {
    body();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "no error";
}

TEST(MapSpecification, SaysWhatIsWrong) {
  EXPECT_EQ(message_of([] { (void)total_order_map(0, 2); }),
            "triangular map in 0 dimensions: at least 1 is needed");
  EXPECT_EQ(message_of([] { (void)total_order_map(2, 24); }),
            "triangular map of order 24: 1 to 23 are possible");
  EXPECT_EQ(message_of([] { (void)total_order_map(2, 0); }),
            "triangular map of order 0: 1 to 23 are possible");
  EXPECT_EQ(message_of([] { (void)sparse_map(total_order_map(2, 2), {{}}); }),
            "sparse map in 2 dimensions: parents are given for 1 components");
  EXPECT_EQ(message_of([] {
              (void)sparse_map(total_order_map(2, 2), {{}, {1}});
            }),
            "sparse map: 1 cannot be a parent of component 1 (only variables before it can)");
}

TEST(Parametrisation, NamesGoThereAndBack) {
  for (auto r : {Rectifier::square, Rectifier::softplus, Rectifier::exponential})
    EXPECT_EQ(rectifier_from(to_text(r)), r);
  EXPECT_EQ(message_of([] { (void)rectifier_from("softpluss"); }),
            "unknown rectifier \"softpluss\" (did you mean \"softplus\"?); the choices are \"square\", "
            "\"softplus\", \"exponential\"");
}

}  // namespace
}  // namespace knothe::posterior

#include "knothe/reduction/compress/separated_tensor.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "knothe/base/error.hpp"

namespace knothe::reduction {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Shapes of order 1 to 4, an index of size 1 among them.
const std::vector<std::vector<Index>> k_shapes = {{7}, {5, 4}, {6, 1, 3}, {4, 5, 3}, {3, 4, 2, 5}};

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  MatrixXd matrix(Index rows, Index columns) {
    return MatrixXd::NullaryExpr(rows, columns, [&] { return normal_(engine_); });
  }
  SeparatedTensor tensor(const std::vector<Index>& shape, Index terms) {
    std::vector<MatrixXd> factors;
    for (const Index n : shape) factors.push_back(matrix(n, terms));
    return SeparatedTensor(factors);
  }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

/// Entries one by one, by the definition.
VectorXd by_definition(const SeparatedTensor& a) {
  const auto shape = a.shape();
  Index size = 1;
  for (const Index n : shape) size *= n;
  VectorXd values(size);
  for (Index place = 0; place < size; ++place) {
    double sum = 0;
    for (Index k = 0; k < a.terms(); ++k) {
      double product = 1;
      Index rest = place;
      for (std::size_t i = shape.size(); i-- > 0; rest /= shape[i])
        product *= a.factors()[i](rest % shape[i], k);
      sum += product;
    }
    values[place] = sum;
  }
  return values;
}

TEST(SeparatedTensor, ArithmeticIsThatOfDenseTensors) {
  Random random(1);
  for (const auto& shape : k_shapes) {
    const SeparatedTensor a = random.tensor(shape, 3), b = random.tensor(shape, 2);
    const VectorXd x = by_definition(a), y = by_definition(b);
    EXPECT_LT((a.dense() - x).norm(), 1e-13 * x.norm());
    EXPECT_LT(((a + b).dense() - (x + y)).norm(), 1e-13 * x.norm());
    EXPECT_LT(((a - 2.5 * b).dense() - (x - 2.5 * y)).norm(), 1e-13 * x.norm());
    EXPECT_LT((hadamard_product(a, b).dense() - x.cwiseProduct(y)).norm(), 1e-13 * x.norm() * y.norm());
    EXPECT_NEAR(inner_product(a, b), x.dot(y), 1e-12 * x.norm() * y.norm());
    EXPECT_NEAR(norm(a), x.norm(), 1e-13 * x.norm());
    EXPECT_EQ((a + SeparatedTensor::zero(shape)).dense(), a.dense());
    std::vector<Index> last;
    for (const Index n : shape) last.push_back(n - 1);
    EXPECT_NEAR(a.at(last), x[x.size() - 1], 1e-13 * x.norm());
  }
}

TEST(SeparatedTensor, CopiesAreIndependent) {
  Random random(2);
  SeparatedTensor a = random.tensor({4, 3}, 2);
  const SeparatedTensor before = a;
  a *= 3.0;
  EXPECT_LT((a.dense() - 3.0 * before.dense()).norm(), 1e-14 * a.dense().norm());
}

TEST(SeparatedTensor, OperatorActsAsTheKroneckerProduct) {
  Random random(3);
  const SeparatedTensor a = random.tensor({3, 4, 2}, 3);
  SeparatedOperator op;
  for (int k = 0; k < 2; ++k)
    op.terms.push_back({random.matrix(2, 3), random.matrix(5, 4), random.matrix(2, 2)});
  const VectorXd x = by_definition(a), image = apply(op, a).dense();
  ASSERT_EQ(image.size(), 2 * 5 * 2);
  for (Index i = 0; i < 2; ++i)
    for (Index j = 0; j < 5; ++j)
      for (Index l = 0; l < 2; ++l) {
        double sum = 0;
        for (const auto& term : op.terms)
          for (Index p = 0; p < 3; ++p)
            for (Index q = 0; q < 4; ++q)
              for (Index r = 0; r < 2; ++r)
                sum += term[0](i, p) * term[1](j, q) * term[2](l, r) * x[(p * 4 + q) * 2 + r];
        EXPECT_NEAR(image[(i * 5 + j) * 2 + l], sum, 1e-12);
      }
}

TEST(SeparatedTensor, RoundingKeepsItsPromiseAndShortens) {
  Random random(4);
  for (const auto& shape : k_shapes) {
    const SeparatedTensor a = random.tensor(shape, 2);
    // The same tensor in eight terms, and a small disturbance.
    SeparatedTensor longer = 0.25 * a + 0.5 * a + 0.25 * a + 1e-7 * random.tensor(shape, 2);
    for (const double tolerance : {1e-2, 1e-5}) {
      const SeparatedTensor shorter = longer.rounded(tolerance);
      const VectorXd x = longer.dense();
      EXPECT_LE((shorter.dense() - x).norm(), tolerance * x.norm());
      EXPECT_LE(shorter.terms(), 2) << "order " << shape.size() << ", tolerance " << tolerance;
    }
  }
}

TEST(SeparatedTensor, RoundingOfRandomTensorsHoldsItsBound) {
  Random random(5);
  for (int round = 0; round < 20; ++round) {
    const SeparatedTensor a = random.tensor(k_shapes[static_cast<std::size_t>(round) % k_shapes.size()], 6);
    for (const double tolerance : {0.5, 0.1, 1e-3}) {
      const SeparatedTensor b = a.rounded(tolerance);
      EXPECT_LE((a.dense() - b.dense()).norm(), tolerance * a.dense().norm() * (1 + 1e-12));
      EXPECT_LE(b.terms(), a.terms());
    }
  }
}

TEST(SeparatedTensor, ATensorThatCancelsRoundsToNothing) {
  Random random(6);
  const SeparatedTensor a = random.tensor({4, 3, 2}, 2);
  const SeparatedTensor nothing = SeparatedTensor::zero({4, 3, 2});
  EXPECT_EQ(nothing.rounded(1e-3).terms(), 0);
  EXPECT_EQ(nothing.dense(), VectorXd::Zero(24));
  EXPECT_LE((a - a).rounded(1e-3).dense().norm(), 1e-12 * a.dense().norm());
}

template <typename Call>
std::string message_of(Call call) {
  try {
    (void)call();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "nothing was thrown";
}

TEST(SeparatedTensor, MistakesAreNamed) {
  using testing::HasSubstr;
  Random random(7);
  const SeparatedTensor a = random.tensor({4, 3}, 2), b = random.tensor({4, 2}, 2);
  EXPECT_THAT(message_of([&] { return a + b; }), HasSubstr("[4, 3] and [4, 2]"));
  EXPECT_THAT(message_of([&] {
                return SeparatedTensor({MatrixXd::Ones(3, 2), MatrixXd::Ones(3, 1)});
              }),
              HasSubstr("factor 1 is 3 × 1"));
  EXPECT_THAT(message_of([&] { return SeparatedTensor({MatrixXd::Constant(2, 2, NAN)}); }),
              HasSubstr("factor 0 has entries that are not finite"));
  EXPECT_THAT(message_of([&] { return SeparatedTensor({}); }), HasSubstr("at least one factor"));
  EXPECT_THAT(message_of([&] { return a.at({0, 3}); }), HasSubstr("index 1 is 3"));
  EXPECT_THAT(message_of([&] { return a.at({0}); }), HasSubstr("its order is 2"));
  EXPECT_THAT(message_of([&] { return a.rounded(1.5); }), HasSubstr("tolerance is 1.5"));
  EXPECT_THAT(message_of([&] {
                return apply({{{MatrixXd::Ones(2, 4), MatrixXd::Ones(2, 2)}}}, a);
              }),
              HasSubstr("matrix 1 of term 0 is 2 × 2; it must be 2 × 3"));
  EXPECT_THAT(message_of([&] { return apply({}, a); }), HasSubstr("at least one term"));
}

}  // namespace
}  // namespace knothe::reduction

#include "knothe/service/journal/noise_bytes.hpp"

#include <zlib.h>

#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

#include "knothe/base/error.hpp"

namespace knothe::service {
namespace {

static_assert(std::endian::native == std::endian::little, "the journal's numbers are little endian");

constexpr std::uint64_t k_max_size = std::uint64_t{1} << 32;  // bytes

[[noreturn]] void damaged() {
  throw DataError("the noise of a measurement in the journal is damaged");
}

template <class Number>
void append(std::string& bytes, const Number* numbers, std::uint64_t count) {
  bytes.append(reinterpret_cast<const char*>(numbers), count * sizeof(Number));
}

template <class Number>
std::vector<Number> read(std::string_view& bytes, std::uint64_t count) {
  if (count > bytes.size() / sizeof(Number)) damaged();
  std::vector<Number> numbers(count);
  if (count > 0) std::memcpy(numbers.data(), bytes.data(), count * sizeof(Number));
  bytes.remove_prefix(count * sizeof(Number));
  return numbers;
}

}  // namespace

std::string noise_bytes(const likelihood::GaussianNoise& noise) {
  const Eigen::SparseMatrix<double> precision = noise.precision();
  const std::uint64_t n = precision.rows(), count = precision.nonZeros();
  const std::uint64_t head[] = {n, count};
  std::string plain;
  append(plain, head, 2);
  append(plain, precision.outerIndexPtr(), n + 1);
  append(plain, precision.innerIndexPtr(), count);
  append(plain, precision.valuePtr(), count);
  uLongf size = compressBound(plain.size());
  const std::uint64_t plain_size = plain.size();
  std::string bytes(sizeof plain_size + size, '\0');
  std::memcpy(bytes.data(), &plain_size, sizeof plain_size);
  compress2(reinterpret_cast<Bytef*>(bytes.data() + sizeof plain_size), &size,
            reinterpret_cast<const Bytef*>(plain.data()), plain.size(), 1);
  bytes.resize(sizeof plain_size + size);
  return bytes;
}

likelihood::GaussianNoise noise_of_bytes(std::string_view bytes) {
  std::uint64_t plain_size = 0;
  if (bytes.size() < sizeof plain_size) damaged();
  std::memcpy(&plain_size, bytes.data(), sizeof plain_size);
  bytes.remove_prefix(sizeof plain_size);
  if (plain_size > k_max_size || plain_size > 1100 * (bytes.size() + 1))
    damaged();  // deflate's best is 1032 : 1
  std::string plain(plain_size, '\0');
  uLongf size = plain_size;
  if (uncompress(reinterpret_cast<Bytef*>(plain.data()), &size, reinterpret_cast<const Bytef*>(bytes.data()),
                 bytes.size()) != Z_OK ||
      size != plain_size)
    damaged();
  std::string_view rest = plain;
  const auto head = read<std::uint64_t>(rest, 2);
  const std::uint64_t n = head[0], count = head[1];
  if (n >= k_max_size || count >= k_max_size) damaged();
  const auto outer = read<int>(rest, n + 1);
  const auto inner = read<int>(rest, count);
  const auto values = read<double>(rest, count);
  if (!rest.empty() || outer.front() != 0 || static_cast<std::uint64_t>(outer.back()) != count) damaged();
  for (std::uint64_t column = 0; column < n; ++column) {
    if (outer[column] > outer[column + 1]) damaged();
    for (int k = outer[column]; k < outer[column + 1]; ++k)
      if (inner[k] < (k == outer[column] ? 0 : inner[k - 1] + 1) || static_cast<std::uint64_t>(inner[k]) >= n)
        damaged();
  }
  const Eigen::Index rows = n;
  const Eigen::Map<const Eigen::SparseMatrix<double>> precision(rows, rows, count, outer.data(), inner.data(),
                                                                values.data());
  return likelihood::GaussianNoise::correlated(precision);
}

}  // namespace knothe::service

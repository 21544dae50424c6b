#include "knothe/files/text_position.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "knothe/base/error.hpp"

namespace knothe::files {

void fail_at_offset(const std::string& path, const std::string& text, std::size_t offset,
                    const std::string& message) {
  offset = std::min(offset, text.size());
  const auto end = text.begin() + offset;
  const auto line = 1 + std::count(text.begin(), end, '\n');
  const std::size_t start = offset == 0 ? std::string::npos : text.rfind('\n', offset - 1);
  throw DataError(fmt::format("{}:{}:{}: error: {}", path, line,
                              start == std::string::npos ? offset + 1 : offset - start, message));
}

}  // namespace knothe::files

#include "knothe/base/error.hpp"

#include <cerrno>
#include <cstring>

namespace knothe {

IoError system_error(const std::string& doing, const std::string& path) {
  const int number = errno;
  std::string remedy;
  if (number == ENOSPC) remedy = " (disk full: free some space, or write elsewhere with -o)";
  if (number == EACCES || number == EROFS) remedy = " (choose a folder you may write to with -o)";
  return IoError(doing + ": " + path + ": " + std::strerror(number) + remedy);
}

}  // namespace knothe

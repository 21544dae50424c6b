#include "knothe/service/net/dead_letters.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <nlohmann/json.hpp>

namespace knothe::service {

bool DeadLetters::store(const Json& letter) const noexcept try {
  const std::string line = letter.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  struct stat found {};
  if (::stat(path_.c_str(), &found) == 0 && found.st_size > 0 &&
      found.st_size + std::ssize(line) > max_bytes_)
    (void)std::rename(path_.c_str(), (path_ + ".1").c_str());
  const int file =
      ::open(path_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC, 0600);
  if (file < 0) return false;
  const bool known = ::fstat(file, &found) == 0;
  const bool whole =
      known && ::write(file, line.data(), line.size()) == std::ssize(line) && ::fsync(file) == 0;
  if (known && !whole && ::ftruncate(file, found.st_size) != 0)
    (void)::write(file, "\n", 1);  // at least it spoils no other
  ::close(file);
  return whole;
} catch (const std::exception&) {
  return false;
}

}  // namespace knothe::service

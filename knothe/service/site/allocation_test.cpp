/// @file The n-th allocation fails, n to exhaustion: npy and journal say so by std::bad_alloc, lose nothing
/// that was committed, and forget no memory (the address sanitizer looks). SQLite's own allocations are not
/// counted: its authors test them so.
#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>
#include <new>

#include "knothe/files/testing/test_folder.hpp"
#include "knothe/service/journal/journal.hpp"
#include "knothe/service/journal/measurement.hpp"

namespace {

thread_local long allocations_left = -1;  // the one after these fails; −1: none does

}  // namespace

void* operator new(std::size_t size) {
  if (allocations_left >= 0 && allocations_left-- == 0) throw std::bad_alloc();
  void* memory = std::malloc(size == 0 ? 1 : size);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
/// Of the same kind, or the address sanitizer finds `delete` to be another's. Not counted: who asks so
/// (std::stable_sort) does without.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  return std::malloc(size == 0 ? 1 : size);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}

namespace knothe::service {
namespace {

/// Runs `action` with each of its allocations failing in turn; `after` each time. How many there were.
int fail_each(const std::function<void()>& action, const std::function<void()>& after) {
  for (int n = 0;; ++n) {
    allocations_left = n;
    bool failed = false;
    try {
      action();
    } catch (const std::bad_alloc&) {
      failed = true;
    }
    const bool reached = allocations_left < 0;
    allocations_left = -1;
    EXPECT_TRUE(failed || !reached) << "allocation " << n << " failed and nobody said so";
    after();
    if (!reached) return n;
  }
}

Measurement datum(std::int64_t seq) {
  Measurement d;
  d.key = {"a camera with a name that is no small string", "session of the twenty-first of November", seq};
  d.time = 0.5;
  d.step = seq;
  d.values = {1e-6, 2e-6, 3e-6};
  d.status = {0, 1, 0};
  return d;
}

/// JSON is not among them: nlohmann's destructor itself allocates, and ends the process where that fails.
TEST(Allocation, TheParserOfNpySaysSo) {
  std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }";
  header.resize(118, ' ');
  const std::string npy = std::string("\x93NUMPY\x01\x00\x76\x00", 10) + header + std::string(16, '\0');
  EXPECT_GT(fail_each(
                [&] {
                  (void)parse_npy_measurement(npy, {"", "camera", "s", "1", "0.5", "good,bad"});
                },
                [] {}),
            0);
}

TEST(Allocation, TheJournalKeepsWhatWasCommittedAndNothingElse) {
  const files::TestFolder folder;
  const std::string path = folder.file("j.journal");
  Journal journal(path);
  std::int64_t committed = 0;
  std::string seal = journal.seal();
  const int allocations = fail_each(
      [&] {
        try {
          journal.begin();
          (void)journal.append(datum(committed));
          (void)journal.append(datum(committed + 1), {true, false});
          (void)journal.release({datum(committed + 1).key});
          (void)journal.withdraw({datum(committed).key});
          journal.commit();
        } catch (...) {
          allocations_left = -1;
          journal.rollback();
          throw;
        }
        committed += 2;
      },
      [&] {
        EXPECT_EQ(journal.count(), committed);
        EXPECT_EQ(journal.withdrawals(), committed / 2);
        if (committed == 0) {
          EXPECT_EQ(journal.seal(), seal);
        }
      });
  EXPECT_GT(allocations, 5);
  EXPECT_EQ(committed, 2);
  EXPECT_EQ(JournalReader(path).count(), 2);
}

}  // namespace
}  // namespace knothe::service

/// @file A journal: opened, read to its end, recovered. A journal that opens is whole, and so is what is
/// recovered.
#include "fuzz/support.hpp"
#include "knothe/service/journal/journal.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace knothe::service;
  const std::string& path = knothe::fuzz::write_scratch(data, size);
  const std::string saved = path + ".saved";
  knothe::fuzz::refuse_or_accept([&] {
    const JournalReader journal(path);
    std::int64_t count = 0;
    journal.for_each([&](const JournalEntry& entry) {
      count += entry.measurement.values.size() == entry.measurement.status.size() ? 1 : 0;
    });
    if (count != journal.count()) std::abort();
    (void)journal.quarantined();
    (void)journal.identity();
  });
  for (const char* tail : {"", ".lock", "-wal", "-shm"}) std::remove((saved + tail).c_str());
  knothe::fuzz::refuse_or_accept([&] {
    const Recovery recovery = recover_journal(path, saved);
    if (JournalReader(saved).count() != recovery.saved) std::abort();
  });
  for (const char* tail : {".saved", ".saved.lock", ".saved-wal", ".saved-shm", "-wal", "-shm"})
    std::remove((path + tail).c_str());
  return 0;
}

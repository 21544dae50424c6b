#pragma once
/// @file The data of a test: the one place where measured values live.
#include <compare>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "knothe/files/nameless_file.hpp"
#include "knothe/likelihood/data/datum.hpp"

namespace knothe::likelihood {

/// A datum that several look at; nobody changes it.
using DatumPointer = std::shared_ptr<const Datum>;

/// Owns the data, by step and then by key, in whatever order they came. What is made of data looks at them
/// here. Data that are seldom looked at may be in a file: 32 bytes a step are in memory then.
///
/// Errors of whatever looks at such data: IoError where the file cannot be read, which is of this process.
class DataSet {
 public:
  /// False where one of its key is there at its step already: nothing changes then. UsageError where the
  /// step's data are of another model time.
  bool add(DatumPointer datum);
  /// False where it is not there.
  bool withdraw(std::size_t step, const DatumKey& key);

  [[nodiscard]] std::vector<std::size_t> step_numbers() const;  ///< with data, increasing
  [[nodiscard]] bool contains(std::size_t step, const DatumKey& key) const;
  [[nodiscard]] std::size_t count(std::size_t step) const;
  [[nodiscard]] std::optional<std::size_t> last_step() const;
  /// The first step ≥ `step` with data.
  [[nodiscard]] std::optional<std::size_t> step_from(std::size_t step) const;
  /// The step with data that is `places` after the first one ≥ `from`.
  [[nodiscard]] std::optional<std::size_t> step_after(std::size_t from, std::size_t places) const;
  /// The last step such that from it to `step` there are `count` data at least, or the first with data.
  [[nodiscard]] std::size_t step_of_last(std::size_t count, std::size_t step) const;
  /// The last datum of a step (by key); null without data.
  [[nodiscard]] DatumPointer last(std::size_t step) const;
  /// The data of a step, by key.
  [[nodiscard]] std::vector<DatumPointer> at(std::size_t step) const;
  /// Those of steps in (`after`, `step`], in order; from the first where `after` is absent.
  [[nodiscard]] std::vector<DatumPointer> between(std::optional<std::size_t> after, std::size_t step) const;
  /// The same, one after the other.
  void for_each(std::optional<std::size_t> after, std::size_t step,
                const std::function<void(const DatumPointer&)>& visit) const;
  [[nodiscard]] std::vector<DatumPointer> all() const;

  /// Lets data be put away into a file in this folder (`keep_in_memory`).
  void set_archive(const std::string& folder) { archive_ = std::make_shared<Archive>(folder); }
  [[nodiscard]] bool has_archive() const { return archive_ != nullptr; }
  [[nodiscard]] std::size_t in_memory() const { return resident_.size(); }  ///< steps
  /// Puts all data away that are not of steps in [`from`, `to`], but those with a noise of their own. Where
  /// the file cannot be written they stay in memory.
  void keep_in_memory(std::size_t from, std::size_t to);

 private:
  using Step = std::map<DatumKey, DatumPointer>;
  /// A step with data, and where they are in the file.
  struct Entry {
    std::size_t step = 0;
    std::int64_t offset = -1;  ///< negative: they are not
    std::uint32_t size = 0;    ///< bytes
    std::uint32_t count = 0;   ///< data
  };
  struct Archive {
    explicit Archive(const std::string& folder) : file(folder) {}
    files::NamelessFile file;
    std::int64_t end = 0;
  };
  using Entries = std::vector<Entry>;
  [[nodiscard]] Entries::const_iterator first_from(std::size_t step) const;
  [[nodiscard]] const Entry* find(std::size_t step) const;
  [[nodiscard]] Step data_of(const Entry& entry) const;
  Step& make_resident(std::size_t step);
  bool put_away(Entry& entry, const Step& data);

  Entries entries_;                       ///< by step
  std::map<std::size_t, Step> resident_;  ///< the data that are in memory
  std::shared_ptr<Archive> archive_;      ///< copies share it: what is written is not written again
};

}  // namespace knothe::likelihood

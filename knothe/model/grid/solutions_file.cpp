#include "knothe/model/grid/solutions_file.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

#include "knothe/base/cancellation.hpp"
#include "knothe/base/error.hpp"
#include "knothe/base/index.hpp"
#include "knothe/base/threads.hpp"
#include "knothe/model/compress/low_rank.hpp"

namespace knothe::model {

using Eigen::MatrixXd;

namespace {

/// Relative to the norm of a block: well above the rounding of single precision, 3e-8, which no few
/// directions hold.
constexpr double k_resolved = 3e-7;

/// An orthonormal basis that grows by what it does not hold of the fields that it is shown.
class GrowingBasis {
 public:
  explicit GrowingBasis(Index dofs, std::size_t threads) : q_(dofs, 0), threads_(threads) {}

  /// Qᵀ u of the columns u, after Q has grown where it was too short.
  MatrixXd coordinates(const Eigen::Map<const MatrixXd>& u) {
    MatrixXd c(q_.cols(), u.cols()), left(u.rows(), u.cols());
    constexpr Index k_columns = 512;  // fixed, so that results do not depend on the number of threads
    parallel_for((u.cols() + k_columns - 1) / k_columns, threads_, [&](std::size_t i) {
      const Index first = i * k_columns, n = std::min(k_columns, u.cols() - first);
      c.middleCols(first, n).noalias() = q_.transpose() * u.middleCols(first, n);
      left.middleCols(first, n) = u.middleCols(first, n);
      left.middleCols(first, n).noalias() -= q_ * c.middleCols(first, n);
    });
    const double allowed = k_resolved * k_resolved * u.squaredNorm();
    // Squares resolve 1e-7 at best: a part at a time.
    for (double rest = left.squaredNorm(); rest > allowed; rest = left.squaredNorm())
      grow(std::max(0.5 * allowed, 1e-8 * rest), left, c);
    if (left.size() > 0) largest_left_out_ = std::max(largest_left_out_, left.cwiseAbs().maxCoeff());
    return c;
  }
  [[nodiscard]] Index size() const { return q_.cols(); }
  /// Of a field that is zero everywhere: any direction.
  [[nodiscard]] MatrixXd q() const { return size() > 0 ? q_ : MatrixXd::Identity(q_.rows(), 1); }
  [[nodiscard]] double largest_left_out() const { return largest_left_out_; }

 private:
  void grow(double allowed, MatrixXd& left, MatrixXd& c) {
    MatrixXd fresh = dominant_space(left, allowed, 1, threads_).basis;
    // `left` is a small difference of large numbers: orthogonal to Q only as far as its rounding errors are.
    for (int i = 0; i < 2; ++i) fresh = orthonormal_basis(fresh - q_ * (q_.transpose() * fresh));
    const Index old = q_.cols(), all = old + fresh.cols();
    q_.conservativeResize(Eigen::NoChange, all);
    q_.rightCols(fresh.cols()) = fresh;
    c.conservativeResize(all, Eigen::NoChange);
    c.bottomRows(fresh.cols()).noalias() = fresh.transpose() * left;
    left.noalias() -= fresh * c.bottomRows(fresh.cols());
  }

  MatrixXd q_;  ///< n_dof × R
  std::size_t threads_;
  double largest_left_out_ = 0;
};

/// Slabs of the field that lie together in the file: the first `fixed` indices fixed, the other ones whole.
class SlabOrder {
 public:
  SlabOrder(const files::Shape& shape, std::size_t block_bytes) : shape_(shape) {
    std::size_t bytes = sizeof(double);
    for (const std::size_t n : shape) bytes *= n;
    while (fixed_ + 2 < shape.size() && bytes > block_bytes) {
      bytes /= shape[fixed_];
      count_ *= shape[fixed_++];
    }
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] std::vector<double> read(const files::Hdf5Reader& file, std::size_t slab) const {
    files::Shape offset(shape_.size(), 0), extent = shape_;
    for (std::size_t i = fixed_; i-- > 0; slab /= shape_[i]) {
      offset[i] = slab % shape_[i];
      extent[i] = 1;
    }
    return file.read_slab("/snapshots", offset, extent);
  }

 private:
  files::Shape shape_;
  std::size_t fixed_ = 0, count_ = 1;
};

/// The coordinates must stay below half of the machine's memory; twice, while they are put together.
void require_memory(const files::Hdf5Reader& file, std::size_t columns, Index directions) {
  const double machine = 1.0 * sysconf(_SC_PHYS_PAGES) * sysconf(_SC_PAGESIZE);
  const double needed = 2.0 * sizeof(double) * columns * directions;
  if (needed <= 0.5 * machine) return;
  throw DataError(fmt::format(
      "{}: data set /snapshots does not fit in memory, nor do its coordinates in the {} directions of space "
      "that it has so far ({:.3g} of {:.3g} GB): import fewer times, dofs or parameter points",
      file.path(), directions, 1e-9 * needed, 1e-9 * machine));
}

}  // namespace

GridSolutions read_solutions(const std::string& path, const SolutionsReading& reading) {
  const files::Hdf5Reader file(path);
  SnapshotFrame frame = read_frame(file);
  const std::size_t columns = frame.snapshots.grid_size() * frame.snapshots.time.size();
  if (sizeof(double) * columns * frame.dofs <= reading.whole_bytes) {
    GridSolutions whole;
    whole.snapshots = read_snapshots(path);
    return whole;
  }
  validate(frame, path);
  const SlabOrder slabs(file.shape("/snapshots"), reading.block_bytes);
  GrowingBasis basis(frame.dofs, reading.threads);
  const auto shown = [&](const std::vector<double>& fields) {
    return basis.coordinates(
        {fields.data(), static_cast<Index>(frame.dofs), static_cast<Index>(fields.size() / frame.dofs)});
  };
  MatrixXd lift = shown(frame.snapshots.lift);
  std::vector<MatrixXd> parts(slabs.count());
  for (Index i = 0; i < std::ssize(parts); ++i) {
    check_cancellation("nothing of the import is kept; start it again");
    std::vector<double> fields = slabs.read(file, i);
    for (double& value : fields) value *= frame.factor;
    parts[i] = shown(fields);
    require_memory(file, columns, basis.size());
  }

  GridSolutions result;
  result.basis = basis.q();
  result.largest_left_out = basis.largest_left_out();
  result.basis_dofs = std::move(frame.snapshots.dofs);
  result.basis_mesh = std::move(frame.snapshots.mesh);
  result.snapshots = std::move(frame.snapshots);
  result.snapshots.dofs = {};
  result.snapshots.mesh.reset();
  const auto put = [&](MatrixXd& part, std::vector<double>& all) {
    part.conservativeResizeLike(MatrixXd::Zero(result.basis.cols(), part.cols()));
    all.insert(all.end(), part.data(), part.data() + part.size());
    part.resize(0, 0);
  };
  result.snapshots.lift.clear();
  put(lift, result.snapshots.lift);
  result.snapshots.values.reserve(columns * result.basis.cols());
  for (MatrixXd& part : parts) put(part, result.snapshots.values);
  return result;
}

}  // namespace knothe::model

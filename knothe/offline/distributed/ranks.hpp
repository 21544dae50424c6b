#pragma once
/// @file The processes of an MPI job (mpirun, srun), where there is one. No MPI type here.

namespace knothe::offline {

/// This process's place in the job. MPI is initialised when first asked, and only under a launcher (Open
/// MPI's, PMI's or PMIx's variables are set): a program started by hand is rank 0 of 1 and never touches MPI,
/// unless it calls start().
///
/// A rank that ends with an error does not finish(): the launcher then ends the others and names it.
struct Ranks {
  int rank = 0;
  int size = 1;

  [[nodiscard]] static Ranks of_this_job();
  /// The same, with MPI initialised in any case, for libraries that need it.
  static Ranks start();
  /// Waits for all others.
  void wait() const;
  /// Over all ranks, the same on each; call them on every rank.
  [[nodiscard]] double sum(double value) const;
  [[nodiscard]] double max(double value) const;
  /// Sums arrays of the same length, in place, on every rank.
  void sum(double* values, int count) const;
  /// The regular end of MPI; call it last, on every rank. Nothing outside a job.
  static void finish();
};

}  // namespace knothe::offline

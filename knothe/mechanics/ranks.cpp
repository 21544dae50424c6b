#include "knothe/mechanics/ranks.hpp"

#include <mpi.h>

#include <cstdlib>

namespace knothe::mechanics {
namespace {

bool launched() {
  for (const char* variable : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK"})
    if (std::getenv(variable) != nullptr) return true;
  return false;
}

bool initialised() {
  int flag = 0;
  MPI_Initialized(&flag);
  return flag != 0;
}

}  // namespace

Ranks Ranks::of_this_job() {
  return launched() || initialised() ? start() : Ranks{};
}

Ranks Ranks::start() {
  Ranks result;
  // MPI's default error handler ends the whole job and says why: nothing to check.
  if (!initialised()) MPI_Init(nullptr, nullptr);
  MPI_Comm_rank(MPI_COMM_WORLD, &result.rank);
  MPI_Comm_size(MPI_COMM_WORLD, &result.size);
  return result;
}

void Ranks::wait() const {
  if (size > 1) MPI_Barrier(MPI_COMM_WORLD);
}

double Ranks::sum(double value) const {
  sum(&value, 1);
  return value;
}

void Ranks::sum(double* values, int count) const {
  if (size > 1) MPI_Allreduce(MPI_IN_PLACE, values, count, MPI_DOUBLE, MPI_SUM, MPI_COMM_WORLD);
}

double Ranks::max(double value) const {
  if (size > 1) MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD);
  return value;
}

void Ranks::finish() {
  int finalised = 0;
  MPI_Finalized(&finalised);
  if (initialised() && finalised == 0) MPI_Finalize();
}

}  // namespace knothe::mechanics

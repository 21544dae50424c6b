#include "knothe/offline/distributed/ranks.hpp"

#include <mpi.h>

#include <cstdlib>
#include <utility>

namespace knothe::offline {
namespace {

bool launched() {
  for (const char* variable : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK"})
    if (std::getenv(variable) != nullptr) return true;
  return false;
}

/// For a process that no launcher started. Open MPI would start a daemon beside it, with ports and a folder
/// of its own under /tmp that processes of the same user make and remove under each other; a job of one rank
/// that starts no others needs none of them. What is set already stays.
void be_the_only_rank() {
  for (const auto& [name, value] :
       {std::pair{"OMPI_MCA_ess_singleton_isolated", "1"},
        std::pair{"OMPI_MCA_orte_create_session_dirs", "0"}, std::pair{"OMPI_MCA_btl", "self"}})
    ::setenv(name, value, 0);
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
  if (!initialised()) {
    if (!launched()) be_the_only_rank();
    MPI_Init(nullptr, nullptr);
  }
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

}  // namespace knothe::offline

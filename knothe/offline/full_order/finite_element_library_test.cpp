#include "knothe/offline/full_order/finite_element_library.hpp"

#include <gtest/gtest.h>

#include "knothe/base/error.hpp"
#include "knothe/files/testing/test_folder.hpp"

namespace {

using namespace knothe::offline;
using knothe::files::message_of;

TEST(FiniteElementLibrary, WhatIsMissingOrSomethingElseIsNamed) {
  const std::string missing =
      message_of<knothe::Error>([] { (void)open_finite_element_library("libnothing.so"); });
  EXPECT_NE(missing.find("could not open the finite elements: libnothing.so: "), std::string::npos)
      << missing;
  EXPECT_NE(missing.find("install the package knothe-offline again"), std::string::npos) << missing;
  const std::string other = message_of<knothe::Error>([] { (void)open_finite_element_library("libm.so.6"); });
  EXPECT_NE(other.find("knothe_finite_element_library"), std::string::npos) << other;
}

TEST(FiniteElementLibrary, ItsErrorsAreThoseOfTheProgram) {
  EXPECT_THROW((void)distribute_mesh({}, 7), knothe::ProjectError);
  EXPECT_THROW((void)distribute_mesh({}, -1), knothe::Error);
}

}  // namespace

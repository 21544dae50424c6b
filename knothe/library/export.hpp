#pragma once
/// @file What the shared library shows: everything else in it is hidden.
#define KNOTHE_EXPORT __attribute__((visibility("default")))

// A switching path as a linear model with a Gaussian prior (see rwa_monitor/switching/friction_model.py).
#pragma once

#include "arrays.hpp"

namespace rwa {

// See results.FlatStory.
struct FlatStory {
    Vector<const std::int64_t> configurations, starts, sojourns, unattributed;
    auto fields() { return std::tie(configurations, starts, sojourns, unattributed); }
};

// See friction_model.Cases.
struct Cases {
    Array<const double, 3> states;
    Matrix<const std::int64_t> choice;
    Vector<const double> log_prior, rest;
    auto fields() { return std::tie(states, choice, log_prior, rest); }
};

// The log evidence of `solve_cases` alone, without the posterior.
double evidence_of_cases(
    const FlatStory& story, Vector<const std::int64_t> borders, Array<const double, 3> table,
    Matrix<const double> moments, const Cases& cases, double variance, double scatter);

}  // namespace rwa

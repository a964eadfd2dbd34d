// What the search for switching paths shares with the levels between candidates and the friction of a path.
#pragma once

#include "arrays.hpp"

namespace rwa {

// ---- a switching path as a linear model with a Gaussian prior (friction.cpp) ----

// See stage_results.SwitchingPath.
struct SwitchingPath {
    Integers configurations, starts, sojourns, unattributed;
    FIELDS(configurations, starts, sojourns, unattributed)
};

// See friction_model.Cases.
struct Cases {
    FloatCube states;
    IntegerMatrix choice;
    Floats log_prior, rest;
    FIELDS(states, choice, log_prior, rest)
};

// The log evidence of `solve_cases` alone, without the posterior.
double evidence_of_cases(
    const SwitchingPath& path, Integers borders, FloatCube table, FloatMatrix statistics,
    const Cases& cases, double variance, double scatter);

}  // namespace rwa

//! Bundle adjustment: features, matches, tracks, and the solver that corrects the RPCs.

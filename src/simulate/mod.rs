//! A deterministic town imaged by satellites with true and disturbed RPCs, and its exact DSM.

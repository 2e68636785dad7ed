//! Errors of the uncertainty model.

/// Why features, maps or a stored head do not fit together.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum UncertaintyError {
    /// Two maps of features differ in shape.
    #[error(
        "features of {} x {} patches with {} channels cannot be compared with {} x {} patches of {} channels",
        .first[0], .first[1], .first[2], .second[0], .second[1], .second[2]
    )]
    Shapes {
        /// Columns, rows and channels of the first map.
        first: [usize; 3],
        /// Columns, rows and channels of the second map.
        second: [usize; 3],
    },
    /// Features have another number of channels than those that a head was made for.
    #[error("features have {found} channels, the uncertainty head was made for {expected}")]
    #[diagnostic(help("continue with the features that training began with"))]
    Channels {
        /// Channels of the features.
        found: usize,
        /// Channels of the head.
        expected: usize,
    },
    /// There is not one dissimilarity for each patch, or no patch at all.
    #[error("{found} dissimilarities for {expected} patches; expected as many, and at least one")]
    Patches {
        /// Number of dissimilarities.
        found: usize,
        /// Number of patches.
        expected: usize,
    },
    /// A stored head is damaged.
    #[error(
        "an uncertainty head of {channels} channels has {field} with {found} finite values, expected {expected}"
    )]
    State {
        /// Channels that the state names.
        channels: usize,
        /// The damaged field.
        field: &'static str,
        /// Number of finite values in it.
        found: usize,
        /// Number of values expected.
        expected: usize,
    },
}

//! The networks of SatGS: their shapes, and their places in one vector of parameters.

use crate::nn::adam::AdamRule;
use crate::nn::hash_grid::HashGrid;
use crate::nn::mlp::Mlp;
use crate::random::CounterRng;
use crate::simd::Real;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Purposes of the random numbers.
const DRAW_TABLES: u64 = 40;
const DRAW_TONE: u64 = 41;
const DRAW_SHADOW: u64 = 42;
const DRAW_SKY: u64 = 43;
const DRAW_EMBEDDING: u64 = 44;
/// Standard deviation of the initial embeddings (WildGaussians).
const EMBEDDING_SIGMA: f64 = 0.01;
/// Initial logit of the share of sunlight: most splats are lit, by 0.88.
const SUNLIT_LOGIT: f64 = 2.0;
/// Initial ambient light.
const AMBIENT: [f64; 3] = [0.30, 0.32, 0.38];

/// The shapes of the networks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Networks {
    /// Number of values of a view's embedding.
    pub embedding: usize,
    /// The encoding of positions.
    pub grid: HashGrid,
    /// From colour, the coarsest position features and the embedding to a factor and an offset of each colour channel.
    pub tone: Mlp,
    /// From position features, the visibility of the sun and the direction to it to the logit of the share of sunlight.
    pub shadow: Mlp,
    /// From the direction to the sun to the logits of the ambient light.
    pub sky: Mlp,
}

/// A group of parameters with the same optimiser and learning rate.
#[derive(Clone, Debug, PartialEq)]
pub struct NetworkGroup {
    /// Where its parameters are.
    pub range: Range<usize>,
    /// The optimiser's rule.
    pub rule: AdamRule,
}

impl Default for Networks {
    /// For areas of about 256 m: cells of the position encoding from 16 m to 0.5 m.
    fn default() -> Self {
        let (embedding, width) = (32, 64);
        let grid = HashGrid { levels: 8, log2_entries: 17, cells: [16, 512] };
        let features = grid.outputs();
        // The coarser half: all of them give test views of JAX_068 the same PSNR (24.60 and 24.61 dB).
        let of_tone = features / 2;
        Self {
            embedding,
            tone: Mlp { inputs: 3 + of_tone, shared: embedding, hidden: vec![width; 2], outputs: 6 },
            shadow: Mlp { inputs: features + 1, shared: 3, hidden: vec![width; 2], outputs: 1 },
            sky: Mlp { inputs: 3, shared: 0, hidden: vec![64], outputs: 3 },
            grid,
        }
    }
}

impl Networks {
    /// Whether inputs and outputs of the networks are what the colour model gives them and takes from them. The tone network may
    /// have the features of any number of coarse levels.
    #[must_use]
    pub fn fit_together(&self) -> bool {
        let shape = |mlp: &Mlp| (mlp.inputs, mlp.shared, mlp.outputs);
        let features = self.grid.outputs();
        (4..=3 + features).contains(&self.tone.inputs)
            && (self.tone.shared, self.tone.outputs) == (self.embedding, 6)
            && shape(&self.shadow) == (features + 1, 3, 1)
            && shape(&self.sky) == (3, 0, 3)
    }

    /// Where the parameters of tables, tone, shadow and sky are.
    #[must_use]
    pub fn ranges(&self) -> [Range<usize>; 4] {
        let sizes =
            [self.grid.parameters(), self.tone.parameters(), self.shadow.parameters(), self.sky.parameters()];
        let mut end = 0;
        sizes.map(|size| {
            end += size;
            end - size..end
        })
    }

    /// Number of parameters of all networks.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.ranges()[3].end
    }

    /// Initial parameters, with which toned colours equal those of the splats.
    #[must_use]
    pub fn start<T: Real>(&self, seed: u64) -> Vec<T> {
        let mut shadow = self.shadow.start::<T>(seed, DRAW_SHADOW);
        let mut sky = self.sky.start::<T>(seed, DRAW_SKY);
        // The last parameters are the biases of the last layer.
        let logits = AMBIENT.map(|a| T::from_f64((a / (1.0 - a)).ln()));
        let first = sky.len() - logits.len();
        sky[first..].copy_from_slice(&logits);
        shadow.last_mut().into_iter().for_each(|bias| *bias = T::from_f64(SUNLIT_LOGIT));
        let tables = self.grid.start::<T>(seed, DRAW_TABLES);
        [tables, self.tone.start(seed, DRAW_TONE), shadow, sky].concat()
    }

    /// The initial embedding of a view.
    #[must_use]
    pub fn start_embedding<T: Real>(&self, seed: u64, view: u64) -> Vec<T> {
        let mut draw = CounterRng::new(seed, DRAW_EMBEDDING, view, 0);
        (0..self.embedding).map(|_| T::from_f64(EMBEDDING_SIGMA * draw.normal())).collect()
    }

    /// The groups of parameters: tables, tone, and shadow with sky.
    #[must_use]
    pub fn groups(&self) -> [NetworkGroup; 3] {
        let [tables, tone, shadow, sky] = self.ranges();
        [
            NetworkGroup { range: tables, rule: AdamRule::HASH_TABLES },
            NetworkGroup { range: tone, rule: AdamRule::DEFAULT },
            NetworkGroup { range: shadow.start..sky.end, rule: AdamRule::DEFAULT },
        ]
    }
}

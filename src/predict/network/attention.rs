//! Attention of queries to the key points around them (Point2GS, equation 5).
//!
//! The weight of key point `i` for a query at `p`, of each head, is the softmax over the nearest key points of
//! `s_i + t_i · x_i - softplus(λ) |x_i|²`, with `x_i = p - p_i` in units of the spacing of the key points. In the usual form the
//! logit is the product of a query `W_q (q + φ x_i)`, with a learned vector `q` that all queries share, and a key `W_k F_i`: it is
//! linear in `x_i`, with coefficients `s_i` and `t_i` that are linear in the features `F_i` of the key point. These are learned
//! directly. Key points further away than the nearest have no weight, as the decay with the distance leaves them nearly none.

use super::blocks::{FeatureBlocks, sum_stripes};
use super::input::{NEIGHBOURS, NetworkInput};
use crate::nn::linear::BLOCK;
use crate::simd::{Real, SimdReal};
use rayon::prelude::*;

/// Number of heads, each with its own weights.
pub const HEADS: usize = 4;
/// Coefficients of the logits of a key point: `s` and `t` of each head.
pub const CODES: usize = HEADS * 4;
/// Added to `λ`, so that the decay is one at the start.
pub const DECAY_AT_START: f64 = 0.541_324_854_612_918;

/// A number of each head and neighbour of a query.
type Weights<T> = [[T; NEIGHBOURS]; HEADS];

/// What the attention is computed from.
#[derive(Clone, Copy)]
pub struct Attention<'a, T> {
    /// Number of values of a key point.
    pub width: usize,
    /// `λ` of each head, relative to the start.
    pub decays: &'a [T],
    /// The queries' neighbours.
    pub input: &'a NetworkInput<T>,
}

/// What the gradient needs of an evaluation.
pub struct AttentionState<T> {
    /// A row for each key point: [`CODES`], then values.
    rows: Vec<T>,
    weights: Vec<Weights<T>>,
}

impl<T> Default for AttentionState<T> {
    fn default() -> Self {
        Self { rows: Vec::new(), weights: Vec::new() }
    }
}

/// `ln(1 + exp(x))`.
fn softplus<T: Real>(x: T) -> T {
    (T::one() + x.exp()).ln()
}

impl<T: SimdReal> Attention<'_, T> {
    fn decay(&self, head: usize) -> T {
        softplus(self.decays[head] + T::from_f64(DECAY_AT_START))
    }

    /// The weights of a query.
    fn weights(&self, rows: &[T], decays: &[T; HEADS], query: usize) -> Weights<T> {
        let stride = CODES + self.width;
        let (near, relative) = (&self.input.neighbours[query], &self.input.relative[query]);
        let mut out = [[T::zero(); NEIGHBOURS]; HEADS];
        for (h, out) in out.iter_mut().enumerate() {
            for n in 0..NEIGHBOURS {
                let code = &rows[near[n] as usize * stride + 4 * h..][..4];
                let [x, y, z] = relative[n];
                let linear = code[0] + code[1] * x + code[2] * y + code[3] * z;
                out[n] = linear - decays[h] * squared(relative[n]);
            }
            let most = out.iter().fold(T::neg_infinity(), |a, b| a.max(*b));
            let sum = out.iter_mut().fold(T::zero(), |sum, v| {
                *v = (*v - most).exp();
                sum + *v
            });
            out.iter_mut().for_each(|v| *v = *v / sum);
        }
        out
    }
}

fn squared<T: Real>([x, y, z]: [T; 3]) -> T {
    x * x + y * y + z * z
}

impl<T: SimdReal> AttentionState<T> {
    /// Writes the features of the queries to the first rows of `out`, from codes and values of the key points.
    pub fn forward(&mut self, attention: Attention<T>, keys: &FeatureBlocks<T>, out: &mut FeatureBlocks<T>) {
        let (width, stride) = (attention.width, CODES + attention.width);
        self.rows.resize(keys.items() * stride, T::zero());
        self.rows.par_chunks_exact_mut(stride).enumerate().for_each(|(item, row)| {
            row.iter_mut().enumerate().for_each(|(k, v)| *v = keys.at(k, item));
        });
        let decays: [T; HEADS] = std::array::from_fn(|h| attention.decay(h));
        let queries = attention.input.neighbours.len();
        self.weights.resize(queries, [[T::zero(); NEIGHBOURS]; HEADS]);
        let (rows, own) = (&self.rows, width / HEADS);
        let blocks = self.weights.par_chunks_mut(BLOCK).zip(out.par_blocks_mut()).enumerate();
        blocks.for_each(|(block, (weights, out))| {
            for (item, weights) in weights.iter_mut().enumerate() {
                let query = block * BLOCK + item;
                *weights = attention.weights(rows, &decays, query);
                let near =
                    attention.input.neighbours[query].map(|i| &rows[i as usize * stride + CODES..][..width]);
                for feature in 0..width {
                    let of_head = &weights[feature / own];
                    let sum = (0..NEIGHBOURS).fold(T::zero(), |sum, n| sum + of_head[n] * near[n][feature]);
                    out[feature * BLOCK + item] = sum;
                }
            }
        });
    }

    /// The derivatives by codes and values of the key points, from those by the features of the queries, the first rows of
    /// `by_features`. Adds those by the decays to `by_decays`.
    pub fn backward(
        &self,
        attention: Attention<T>,
        by_features: &FeatureBlocks<T>,
        by_decays: &mut [T],
    ) -> FeatureBlocks<T> {
        let (width, stride) = (attention.width, CODES + attention.width);
        let own = width / HEADS;
        let Attention { input, .. } = attention;
        // By the queries' features a row for each, and by the logits.
        let by_rows: Vec<(Vec<T>, Weights<T>)> = (0..self.weights.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|query| {
                let by: Vec<T> = (0..width).map(|f| by_features.at(f, query)).collect();
                let mut by_logits = self.weights[query];
                for (h, weights) in by_logits.iter_mut().enumerate() {
                    let by_weights: [T; NEIGHBOURS] = std::array::from_fn(|n| {
                        let first = input.neighbours[query][n] as usize * stride + CODES + h * own;
                        let values = &self.rows[first..first + own];
                        values.iter().zip(&by[h * own..]).fold(T::zero(), |sum, (v, by)| sum + *v * *by)
                    });
                    let mean = weights.iter().zip(by_weights).fold(T::zero(), |sum, (w, by)| sum + *w * by);
                    weights.iter_mut().zip(by_weights).for_each(|(w, by)| *w = *w * (by - mean));
                }
                (by, by_logits)
            })
            .collect();
        let queries = by_rows.par_chunks(BLOCK).enumerate();
        let mut by_decay = [T::zero(); HEADS];
        sum_stripes(queries, &mut by_decay, |(block, by_rows), sums| {
            for (item, (_, by_logits)) in by_rows.iter().enumerate() {
                for (n, relative) in input.relative[block * BLOCK + item].iter().enumerate() {
                    for h in 0..HEADS {
                        sums[h] = sums[h] - by_logits[h][n] * squared(*relative);
                    }
                }
            }
        });
        for h in 0..HEADS {
            // The derivative of softplus is the logistic function.
            let x = attention.decays[h] + T::from_f64(DECAY_AT_START);
            by_decays[h] = by_decays[h] + by_decay[h] / (T::one() + (-x).exp());
        }
        let uses = Uses::of(input, self.rows.len() / stride);
        let rows: Vec<Vec<T>> = (0..uses.keys())
            .into_par_iter()
            .map(|key| {
                let mut row = vec![T::zero(); stride];
                for &(query, n) in uses.of_key(key) {
                    let (query, n) = (query as usize, n as usize);
                    let (by, by_logits) = &by_rows[query];
                    let [x, y, z] = input.relative[query][n];
                    for h in 0..HEADS {
                        let by_logit = by_logits[h][n];
                        let code = &mut row[4 * h..4 * h + 4];
                        for (sum, v) in code.iter_mut().zip([T::one(), x, y, z]) {
                            *sum = *sum + by_logit * v;
                        }
                        let weight = self.weights[query][h][n];
                        let values = &mut row[CODES + h * own..][..own];
                        for (sum, by) in values.iter_mut().zip(&by[h * own..]) {
                            *sum = *sum + weight * *by;
                        }
                    }
                }
                row
            })
            .collect();
        let mut out = FeatureBlocks::zeros(stride, rows.len());
        for (item, row) in rows.iter().enumerate() {
            row.iter().enumerate().for_each(|(k, v)| *out.at_mut(k, item) = *v);
        }
        out
    }
}

/// For each key point the queries that attend to it, in their order, with its place among their neighbours.
struct Uses {
    first: Vec<usize>,
    uses: Vec<(u32, u32)>,
}

impl Uses {
    fn of<T>(input: &NetworkInput<T>, keys: usize) -> Self {
        let mut first = vec![0; keys + 1];
        input.neighbours.iter().flatten().for_each(|key| first[*key as usize + 1] += 1);
        for k in 0..keys {
            first[k + 1] += first[k];
        }
        let mut next = first.clone();
        let mut uses = vec![(0, 0); first[keys]];
        for (query, near) in input.neighbours.iter().enumerate() {
            for (n, key) in near.iter().enumerate() {
                let place = &mut next[*key as usize];
                uses[*place] = (query as u32, n as u32);
                *place += 1;
            }
        }
        Self { first, uses }
    }

    fn keys(&self) -> usize {
        self.first.len() - 1
    }

    fn of_key(&self, key: usize) -> &[(u32, u32)] {
        &self.uses[self.first[key]..self.first[key + 1]]
    }
}

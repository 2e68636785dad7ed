//! The ridges and valleys that rivers leave of land that rises: the stream power law with slopes that slide above an angle of
//! repose, solved implicitly in the order of heights (Braun and Willett 2013, "A very efficient O(n), implicit and parallel
//! method to solve the stream power equation governing fluvial incision and landscape evolution", Geomorphology 180).

use super::keyed_rng::KeyedRng;

/// Cells along each side; the land repeats beyond them.
const SIDE: usize = 256;
/// Side of a cell, metres.
const CELL_M: f64 = 6.0;
/// Number of time steps, and what the land rises in each, metres: far more in all than rivers leave standing.
const STEPS: usize = 200;
const RISE_M: f64 = 4.0;
/// Gradient at which a river that drains one cell erodes as fast as the land rises.
const STEEPNESS: f64 = 2.2;
/// Exponent of the drained area: of torrents with debris flows, which are steeper than rivers on plains (0.5).
const AREA_EXPONENT: f64 = 0.22;
/// Lowest and highest gradient above which slopes slide: those of loose and of sound rock.
const REPOSE: (f64, f64) = (0.42, 0.95);
/// Distance over which the soundness of the rock varies, metres.
const ROCK_M: f64 = 190.0;
/// Share of the difference from the mean of its neighbours by which creep lowers a cell in a step.
const CREEP: f64 = 0.05;
/// Offsets of the neighbours, (columns, rows).
const AROUND: [(usize, usize); 8] = [
    (1, 0),
    (SIDE - 1, 0),
    (0, 1),
    (0, SIDE - 1),
    (1, 1),
    (SIDE - 1, 1),
    (1, SIDE - 1),
    (SIDE - 1, SIDE - 1),
];

/// Eroded land: a range of mountains half way between two rivers that flow at height 0.
pub(super) struct Land {
    /// Heights of the cells, row by row, metres.
    heights_m: Vec<f64>,
}

impl Land {
    /// Erodes the land of an address of random numbers.
    pub(super) fn eroded(rng: KeyedRng) -> Self {
        let cells = SIDE * SIDE;
        let place = |k: usize| ((k % SIDE) as f64 * CELL_M, (k / SIDE) as f64 * CELL_M);
        let repose: Vec<f64> = (0..cells)
            .map(|k| {
                let (x, y) = place(k);
                // Turned, so that borders of rock do not follow the axes.
                let (u, v) = (0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y);
                let sound = 0.5 + 0.9 * rng.key(1).fractal_noise(u, v, ROCK_M, 4);
                REPOSE.0 + (REPOSE.1 - REPOSE.0) * sound.clamp(0.0, 1.0)
            })
            .collect();
        let mut land = Self { heights_m: (0..cells).map(|k| rng.key(2).key(k as i64).uniform()).collect() };
        for _ in 0..STEPS {
            land.rise_and_erode(&repose);
            land.creep();
        }
        land
    }

    /// Height above the rivers, and the gradient to the east and to the north, at a place in metres from the middle of the
    /// range: of the cubic B-spline of the cells, which has no kinks.
    pub(super) fn at(&self, x: f64, y: f64) -> (f64, [f64; 2]) {
        let (u, v) = (x / CELL_M, y / CELL_M + 0.5 * SIDE as f64);
        let (i, j) = (u.floor(), v.floor());
        let ((wu, du), (wv, dv)) = (spline(u - i), spline(v - j));
        let (mut height, mut gradient) = (0.0, [0.0; 2]);
        for (r, (weight_v, slope_v)) in wv.into_iter().zip(dv).enumerate() {
            for (c, (weight_u, slope_u)) in wu.into_iter().zip(du).enumerate() {
                let wrapped = |k: f64| k.rem_euclid(SIDE as f64) as usize;
                let cell = wrapped(j + r as f64 - 1.0) * SIDE + wrapped(i + c as f64 - 1.0);
                let h = self.heights_m[cell];
                height += weight_u * weight_v * h;
                gradient[0] += slope_u * weight_v * h / CELL_M;
                gradient[1] += weight_u * slope_v * h / CELL_M;
            }
        }
        (height, gradient)
    }

    fn rise_and_erode(&mut self, repose: &[f64]) {
        let h = &mut self.heights_m;
        (0..h.len()).filter(|k| !is_river(*k)).for_each(|k| h[k] += RISE_M);
        // The neighbour to which the water of a cell flows, and its distance; none in hollows and rivers.
        let below: Vec<Option<(usize, f64)>> = (0..h.len())
            .map(|k| {
                let fall = |(n, distance_m): &(usize, f64)| (h[k] - h[*n]) / distance_m;
                let steepest = neighbours(k).max_by(|a, b| fall(a).total_cmp(&fall(b)))?;
                (!is_river(k) && fall(&steepest) > 0.0).then_some(steepest)
            })
            .collect();
        let mut order: Vec<usize> = (0..h.len()).collect();
        order.sort_by(|a, b| h[*a].total_cmp(&h[*b]).then(a.cmp(b)));
        let mut drained = vec![1.0f64; h.len()];
        for k in order.iter().rev() {
            if let Some((n, _)) = below[*k] {
                drained[n] += drained[*k];
            }
        }
        for k in order {
            if let Some((n, distance_m)) = below[k] {
                let rate = RISE_M / STEEPNESS * drained[k].powf(AREA_EXPONENT) / distance_m;
                h[k] = ((h[k] + rate * h[n]) / (1.0 + rate)).min(h[n] + repose[k] * distance_m);
            }
        }
    }

    fn creep(&mut self) {
        let before = self.heights_m.clone();
        for (k, h) in self.heights_m.iter_mut().enumerate().filter(|(k, _)| !is_river(*k)) {
            let mean = neighbours(k).map(|(n, _)| before[n]).sum::<f64>() / AROUND.len() as f64;
            *h += CREEP * (mean - before[k]);
        }
    }
}

/// Whether the river flows through a cell: it meanders along the first row.
fn is_river(cell: usize) -> bool {
    let (col, row) = (cell % SIDE, cell / SIDE);
    let bend = (9.0 * (std::f64::consts::TAU * 2.0 * col as f64 / SIDE as f64).sin()).round();
    row as f64 == bend.rem_euclid(SIDE as f64)
}

/// The neighbours of a cell and their distances, metres.
fn neighbours(cell: usize) -> impl Iterator<Item = (usize, f64)> {
    let (col, row) = (cell % SIDE, cell / SIDE);
    AROUND.into_iter().map(move |(right, down)| {
        let distance_m = if right == 0 || down == 0 { CELL_M } else { CELL_M * std::f64::consts::SQRT_2 };
        ((row + down) % SIDE * SIDE + (col + right) % SIDE, distance_m)
    })
}

/// Weights of four cells at a fraction of a cell behind the second of them, and their derivatives.
fn spline(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    let weights = [
        s * s * s / 6.0,
        (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
        (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
        t * t * t / 6.0,
    ];
    (weights, [-0.5 * s * s, 1.5 * t * t - 2.0 * t, 2.0 * s - 1.5 * s * s, 0.5 * t * t])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_that_of_the_height() {
        let land =
            Land { heights_m: (0..SIDE * SIDE).map(|k| KeyedRng::new(3).key(k as i64).uniform()).collect() };
        for (x, y) in [(3.7, -12.2), (-800.0, 400.3), (0.0, 0.0)] {
            let (_, [east, north]) = land.at(x, y);
            let rate = |dx: f64, dy: f64| (land.at(x + dx, y + dy).0 - land.at(x - dx, y - dy).0) / 2e-4;
            assert!((east - rate(1e-4, 0.0)).abs() < 1e-6 && (north - rate(0.0, 1e-4)).abs() < 1e-6);
        }
    }
}

//! Key points by farthest-point sampling, and the groups of points around them (Point2GS §3.2).

use super::Cloud;
use super::network::GROUP;
use std::num::NonZero;

/// Farthest-point sampling: indices of points such that each is the one furthest from those before it, until no point is further
/// than `spacing` from all of them, or there are `most`. Begins with the point nearest to the mean.
#[must_use]
pub fn farthest_points(points: &[[f32; 3]], spacing: f32, most: usize) -> Vec<usize> {
    let count = points.len().max(1) as f64;
    let mean: [f32; 3] =
        std::array::from_fn(|k| (points.iter().map(|p| f64::from(p[k])).sum::<f64>() / count) as f32);
    let first =
        (0..points.len()).min_by(|a, b| squared(points[*a], mean).total_cmp(&squared(points[*b], mean)));
    let Some(mut next) = first else { return Vec::new() };
    let mut distances = vec![f32::INFINITY; points.len()];
    let mut chosen = Vec::new();
    while chosen.len() < most {
        chosen.push(next);
        let from = points[next];
        let (mut furthest, mut at) = (0.0, 0);
        for (i, (p, distance)) in points.iter().zip(&mut distances).enumerate() {
            *distance = distance.min(squared(*p, from));
            if *distance > furthest {
                (furthest, at) = (*distance, i);
            }
        }
        if furthest <= spacing * spacing {
            break;
        }
        next = at;
    }
    chosen
}

fn squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum()
}

/// Indices of the points of the group around a position: the [`GROUP`] nearest; the nearest is repeated where the cloud has fewer.
#[must_use]
pub fn group(cloud: &Cloud, p: [f64; 3]) -> [usize; GROUP] {
    const COUNT: NonZero<usize> = NonZero::new(GROUP).unwrap();
    let mut out = [0; GROUP];
    let mut found = 0;
    for (index, _) in cloud.nearest(p, COUNT) {
        (out[found], found) = (index, found + 1);
    }
    let nearest = out[0];
    out[found..].fill(nearest);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn farthest_points_cover_the_points_and_keep_their_distance() {
        let points: Vec<[f32; 3]> =
            (0..1600).map(|i| [(i % 40) as f32 * 0.5, (i / 40) as f32 * 0.5, 0.0]).collect();
        let chosen = farthest_points(&points, 2.0, usize::MAX);
        for p in &points {
            assert!(chosen.iter().any(|i| squared(points[*i], *p) <= 4.0));
        }
        let nearest = |i: &usize| {
            let others = chosen.iter().filter(|j| *j != i);
            others.map(|j| squared(points[*i], points[*j])).fold(f32::INFINITY, f32::min)
        };
        assert!(chosen.iter().map(nearest).fold(f32::INFINITY, f32::min) > 4.0);
        assert_eq!(farthest_points(&points, 2.0, 7), chosen[..7]);
        assert_eq!(farthest_points(&[], 1.0, 5), Vec::<usize>::new());
    }
}

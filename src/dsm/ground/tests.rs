use super::*;

const CELL_M: f64 = 0.5;

/// A grid of 240 x 240 cells of half a metre.
fn grid(height: impl Fn(f32, f32) -> f32) -> Grid2 {
    Grid2::from_fn(240, 240, |col, row| height(0.5 * col as f32, 0.5 * row as f32))
}

fn worst(a: &Grid2, b: &Grid2) -> f32 {
    a.data.iter().zip(&b.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn inside(x: f32, y: f32, [west, east, south, north]: [f32; 4]) -> bool {
    (west..east).contains(&x) && (south..north).contains(&y)
}

#[test]
fn houses_trees_and_a_hall_go_from_a_slope() {
    let slope = |x: f32, y: f32| 0.1 * x + 0.05 * y;
    let surface = grid(|x, y| {
        let on_top = if inside(x, y, [10.0, 22.0, 10.0, 20.0]) {
            7.0
        } else if inside(x, y, [30.0, 40.0, 10.0, 22.0]) {
            // A gable, which rises from its eaves.
            4.0 + 3.0 * (1.0 - (x - 35.0).abs() / 5.0)
        } else if inside(x, y, [40.0, 100.0, 40.0, 90.0]) {
            // A hall, whose roof is level.
            8.0 + slope(70.0, 65.0) - slope(x, y)
        } else if (x - 15.0).hypot(y - 60.0) < 4.0 {
            9.0
        } else if inside(x, y, [105.0, 120.0, 0.0, 15.0]) {
            // A tower at the border, at the upper end of the slope.
            25.0
        } else {
            0.0
        };
        slope(x, y) + on_top
    });
    let ground = bare_ground(&surface, CELL_M);
    let truth = grid(slope);
    assert!(worst(&ground, &truth) < 1.2, "{}", worst(&ground, &truth));
    let mean = ground.data.iter().zip(&truth.data).map(|(a, b)| (a - b).abs()).sum::<f32>() / 57_600.0;
    assert!(mean < 0.12, "{mean}");
    // The ground itself is not smoothed.
    assert_eq!(ground.at(5, 5), surface.at(5, 5));
}

#[test]
fn steep_ridges_stay() {
    let ridge = grid(|x, y| 14.0 * (x / 20.0).sin() + 0.3 * y);
    let lost = worst(&bare_ground(&ridge, CELL_M), &ridge);
    assert!(lost < 1.5, "{lost}");
}

#[test]
fn cells_without_heights_stay_so_and_a_pit_is_no_ground() {
    let mut surface = grid(|x, _| 0.02 * x);
    surface.data[100 * 240 + 100] = -30.0;
    surface.data[50] = f32::NAN;
    let ground = bare_ground(&surface, CELL_M);
    assert!(ground.data[50].is_nan());
    assert_eq!(ground.valid().count(), 240 * 240 - 1);
    assert!((ground.at(100, 100) - 1.0).abs() < 0.1, "{}", ground.at(100, 100));
    let empty = Grid2::filled(30, 20, f32::NAN);
    assert!(bare_ground(&empty, CELL_M).data.iter().all(|v| v.is_nan()));
    // A single cell, and a grid narrower than a block.
    assert_eq!(bare_ground(&Grid2::filled(1, 1, 4.0), CELL_M).data, [4.0]);
    assert_eq!(bare_ground(&Grid2::filled(3, 1, 4.0), 0.1).data, [4.0; 3]);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let surface =
        grid(|x, y| 3.0 * (0.1 * x).sin() + if inside(x, y, [20.0, 60.0, 20.0, 50.0]) { 9.0 } else { 0.0 });
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| bare_ground(&surface, CELL_M))
    };
    assert_eq!(with(1), with(3));
}

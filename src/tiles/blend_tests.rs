//! Cores that jobs blend apart are those of one blend of all tiles.

use super::cut::{BANDS, least_cost_cut, linear_share, mixed, owned_share};
use super::made_tests::{Made, OVERLAP, town};
use super::{Blended, Plan, TilesError, blend, tile_folder};
use crate::io::{Grid2, ImageFile, write_json};
use crate::pipeline::Outcome;
use crate::progress::NoProgress;
use crate::run_files::{CONFIDENCE, DSM, MOSAIC, ORTHO, PLAN};
use std::path::Path;

type Bands = [Grid2; BANDS];

const O: usize = OVERLAP;

fn at(bands: &Bands, col: usize, row: usize) -> [f32; BANDS] {
    std::array::from_fn(|i| bands[i].at(col, row))
}

fn set(bands: &mut Bands, col: usize, row: usize, values: [f32; BANDS]) {
    for (band, value) in bands.iter_mut().zip(values) {
        let cell = row * band.width + col;
        band.data[cell] = value;
    }
}

/// One blend of all tiles, in memory and with a margin of the overlap: all rows of tiles are joined as a whole, then all rows.
/// `absent` are (column, row) of tiles that are left out.
fn all_at_once(made: &Made, absent: &[(usize, usize)]) -> Bands {
    let (columns, rows) = (made.columns.len(), made.rows.len());
    let width = made.columns.iter().sum::<usize>() + 2 * O;
    let height = made.rows.iter().sum::<usize>() + 2 * O;
    let none = |w: usize, h: usize| -> Bands { std::array::from_fn(|_| Grid2::filled(w, h, f32::NAN)) };
    let is_there = |col: usize, row: usize| !absent.contains(&(col, row));
    let mut out = none(width, height);
    for row in (0..rows).rev() {
        let lines = made.rows[row] + 2 * O;
        let mut joined = none(width, lines);
        for col in 0..columns {
            let west = made.start(col, row).0 as usize;
            let (bands, there) = (made.bands(col, row), is_there(col, row));
            let cell = |c: usize, r: usize| if there { at(&bands, c, r) } else { [f32::NAN; BANDS] };
            let before = if col > 0 { 2 * O } else { 0 };
            if before > 0 {
                let d = Grid2::from_fn(before, lines, |c, r| joined[0].at(west + c, r) - cell(c, r)[0]);
                let cut = least_cost_cut(&d, None, None);
                for r in 0..lines {
                    for c in 0..before {
                        let owned =
                            if there && is_there(col - 1, row) { owned_share(c, cut[r]) } else { 0.5 };
                        let (v, _) =
                            mixed(&at(&joined, west + c, r), &cell(c, r), linear_share(c, before), owned);
                        set(&mut joined, west + c, r, v);
                    }
                }
            }
            for r in 0..lines {
                for c in before..bands[0].width {
                    set(&mut joined, west + c, r, cell(c, r));
                }
            }
        }
        let north = made.start(0, row).1 as usize;
        let before = if row + 1 < rows { 2 * O } else { 0 };
        if before > 0 {
            let d = Grid2::from_fn(before, width, |across, c| {
                out[0].at(c, north + across) - joined[0].at(c, across)
            });
            let part = |from: usize, lines: usize| Grid2::from_fn(before, lines, |a, l| d.at(a, from + l));
            let column_is_there = |col: usize| is_there(col, row) || is_there(col, row + 1);
            for col in 0..columns {
                let (west, cells) = (made.start(col, row).0 as usize, made.columns[col]);
                let pass = |from: usize| least_cost_cut(&part(from, 2 * O), None, None)[O];
                let first = (col > 0 && column_is_there(col - 1)).then(|| pass(west));
                let last = (col + 1 < columns && column_is_there(col + 1)).then(|| pass(west + cells));
                let cut = least_cost_cut(&part(west + O, cells), first, last);
                for a in 0..before {
                    for c in 0..cells {
                        let (x, y) = (west + O + c, north + a);
                        let (linear, owned) = (linear_share(a, before), owned_share(a, cut[c]));
                        let (v, _) = mixed(&at(&out, x, y), &at(&joined, x, a), linear, owned);
                        set(&mut joined, x, a, v);
                    }
                }
            }
        }
        for r in 0..lines {
            for c in 0..width {
                set(&mut out, c, north + r, at(&joined, c, r));
            }
        }
    }
    out
}

fn core(run: &Path, id: &str) -> Bands {
    let open = |name: &str| ImageFile::open(&run.join(MOSAIC).join(format!("{id}_{name}"))).unwrap();
    let (dsm, ortho, confidence) = (open(DSM), open(ORTHO), open(CONFIDENCE));
    let of = |file: &ImageFile, band: usize| file.read(band).unwrap();
    [
        of(&dsm, 1),
        of(&ortho, 1),
        of(&ortho, 2),
        of(&ortho, 3),
        of(&confidence, 1),
        of(&confidence, 2),
        of(&confidence, 3),
        of(&confidence, 4),
    ]
}

fn check(made: &Made, absent: &[(usize, usize)]) {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    made.write(run);
    let without: Vec<String> = absent.iter().map(|&(c, r)| Made::id(c, r)).collect();
    let expected = all_at_once(made, absent);
    for row in 0..made.rows.len() {
        for col in (0..made.columns.len()).filter(|col| !absent.contains(&(*col, row))) {
            let id = Made::id(col, row);
            blend(run, &id, &without, &NoProgress).unwrap();
            let (bands, (west, north)) = (core(run, &id), made.start(col, row));
            assert_eq!((bands[0].width, bands[0].height), (made.columns[col], made.rows[row]));
            for (i, band) in bands.iter().enumerate() {
                for (k, v) in band.data.iter().enumerate() {
                    let (c, r) = (k % band.width, k / band.width);
                    let e = expected[i].at(west as usize + O + c, north as usize + O + r);
                    let e = if (1..4).contains(&i) { e.round() } else { e };
                    assert!(*v == e || v.is_nan() && e.is_nan(), "{id}, band {i}, ({c}, {r}): {v}, not {e}");
                }
            }
        }
    }
}

#[test]
fn jobs_blend_the_same_cells_as_one_blend_of_all_tiles() {
    for seed in 0..3 {
        check(&Made { columns: &[24, 16, 31], rows: &[20, 24, 17], at: &town(seed) }, &[]);
    }
}

#[test]
fn absent_tiles_leave_the_rest_as_one_blend_makes_it() {
    check(&Made { columns: &[24, 20, 24], rows: &[20, 24, 20], at: &town(7) }, &[(1, 1)]);
    check(&Made { columns: &[24, 20], rows: &[20, 24], at: &town(8) }, &[(0, 0), (1, 1)]);
}

#[test]
fn single_rows_columns_and_tiles_are_blended() {
    check(&Made { columns: &[24, 20, 24], rows: &[20], at: &town(1) }, &[]);
    check(&Made { columns: &[20], rows: &[20, 24, 16], at: &town(2) }, &[]);
    check(&Made { columns: &[20], rows: &[20], at: &town(3) }, &[]);
}

/// Both tiles show a roof, the second one a cell farther east: averages would stand between roof and ground.
#[test]
fn roofs_that_differ_by_a_cell_get_no_half_height_rims() {
    let at = |tile: usize, _: usize, col: i64, _: i64| {
        let roof = (20..30).contains(&(col + tile as i64));
        [if roof { 18.0 } else { 10.0 }, 100.0, 100.0, 100.0, 1.0, 0.1, 3.0, 0.2]
    };
    let made = Made { columns: &[24, 24], rows: &[24], at: &at };
    let folder = tempfile::tempdir().unwrap();
    made.write(folder.path());
    for id in [Made::id(0, 0), Made::id(1, 0)] {
        blend(folder.path(), &id, &[], &NoProgress).unwrap();
        let heights = &core(folder.path(), &id)[0];
        assert!(heights.data.iter().all(|h| *h == 10.0 || *h == 18.0), "{id}");
    }
}

#[test]
fn a_constant_step_is_measured_and_spread_over_the_strip() {
    let at = |tile: usize, _: usize, _: i64, _: i64| {
        [10.0 + 0.4 * tile as f32, 100.0, 100.0, 100.0, 1.0, 0.1, 3.0, 0.2]
    };
    let made = Made { columns: &[24, 24], rows: &[24], at: &at };
    let folder = tempfile::tempdir().unwrap();
    made.write(folder.path());
    let Outcome::Made(west) = blend(folder.path(), &Made::id(0, 0), &[], &NoProgress).unwrap() else {
        panic!()
    };
    assert_eq!(west.seams.len(), 1);
    let seam = &west.seams[0];
    assert_eq!((seam.tiles.clone(), seam.cells), ([Made::id(0, 0), Made::id(1, 0)], 2 * O * 24));
    assert!((seam.median_m.unwrap() + 0.4).abs() < 1e-5 && seam.over_1m == Some(0.0));
    assert!(seam.line[0][0] == seam.line[1][0] && seam.line[0][1] > seam.line[1][1]);
    let heights = &core(folder.path(), &Made::id(0, 0))[0];
    for (col, expected) in [(15, 10.0), (16, 10.0 + 0.4 * 0.5 / 16.0), (23, 10.0 + 0.4 * 7.5 / 16.0)] {
        assert!((heights.at(col, 5) - expected as f32).abs() < 1e-5, "{col}: {}", heights.at(col, 5));
    }
    let Outcome::Made(east) = blend(folder.path(), &Made::id(1, 0), &[], &NoProgress).unwrap() else {
        panic!()
    };
    assert!(east.seams.is_empty(), "the seam is that of the western tile");
}

#[test]
fn a_core_is_kept_until_a_file_of_a_neighbour_changes() {
    let made = Made { columns: &[20, 20], rows: &[20], at: &town(4) };
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    made.write(run);
    let again = || blend(run, "x000_y000", &[], &NoProgress);
    let Outcome::Made(first) = again().unwrap() else { panic!("it is made") };
    let path = run.join(MOSAIC).join("x000_y000_dsm.tif");
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(again().unwrap(), Outcome::Kept(Some(first.clone())));
    std::fs::remove_file(&path).unwrap();
    assert_eq!(again().unwrap(), Outcome::Made(first));
    assert!(std::fs::read(&path).unwrap() == bytes, "the same bytes");
    Made { at: &town(5), ..made }.write_tile(run, 1, 0);
    assert!(matches!(again().unwrap(), Outcome::Made(Blended { .. })));
}

#[test]
fn a_neighbour_that_is_not_done_must_be_left_out_by_name() {
    let made = Made { columns: &[20, 20], rows: &[20], at: &town(4) };
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    made.write(run);
    let dsm = tile_folder(run, "x001_y000").join(DSM);
    std::fs::write(&dsm, "cut short").unwrap();
    let refused = blend(run, "x000_y000", &[], &NoProgress).unwrap_err();
    assert!(matches!(&refused, TilesError::NotDone { id, .. } if id == "x001_y000"), "{refused}");
    blend(run, "x000_y000", &["x001_y000".into()], &NoProgress).unwrap();
    let refused = blend(run, "x001_y000", &["x001_y000".into()], &NoProgress).unwrap_err();
    assert!(matches!(refused, TilesError::NotDone { .. }), "{refused}");
    assert!(matches!(blend(run, "x9", &[], &NoProgress).unwrap_err(), TilesError::NoTile { .. }));
}

#[test]
fn cores_that_are_too_narrow_or_not_in_rows_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    let narrow = Made { columns: &[20, 15], rows: &[20], at: &town(4) };
    narrow.write(run);
    let refused = |run: &Path| blend(run, "x000_y000", &[], &NoProgress).unwrap_err().to_string();
    assert!(refused(run).contains("narrower than twice the overlap"));
    let mut plan: Plan = Made { columns: &[20, 20], ..narrow }.plan();
    plan.tiles[1].core[1] -= 1.0;
    write_json(&run.join(PLAN), &plan).unwrap();
    assert!(refused(run).contains("not in rows and columns"));
}

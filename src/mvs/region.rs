//! Regions of connected cells of a grid.

/// The cells of a grid beside a cell: left, right, above and below; none beyond the grid.
pub(super) fn neighbours((width, height): (usize, usize), cell: usize) -> [Option<usize>; 4] {
    [
        (!cell.is_multiple_of(width)).then(|| cell - 1),
        (!(cell + 1).is_multiple_of(width)).then_some(cell + 1),
        cell.checked_sub(width),
        Some(cell + width).filter(|below| *below < width * height),
    ]
}

/// Appends to `cells` their neighbours that are not taken and are alike, and the neighbours of these, in so many rounds.
pub(super) fn grow(
    cells: &mut Vec<usize>,
    rounds: usize,
    size: (usize, usize),
    is_taken: &mut [bool],
    is_alike: impl Fn(usize, usize) -> bool,
) {
    let mut front = 0;
    for _ in 0..rounds {
        let end = cells.len();
        for k in front..end {
            let cell = cells[k];
            for next in neighbours(size, cell).into_iter().flatten() {
                if !is_taken[next] && is_alike(cell, next) {
                    is_taken[next] = true;
                    cells.push(next);
                }
            }
        }
        if cells.len() == end {
            return;
        }
        front = end;
    }
}

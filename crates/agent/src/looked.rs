//! Where a robot has looked, on a grid coarse enough to travel.

use crate::Error;
use graph_align::Looked;
use gsm::Map;
use nalgebra::{Point3, UnitQuaternion};
use std::collections::BTreeMap;

/// Side of a cell, metres.
const CELL: f32 = 0.5;
/// Share of a cell's volume that must have been observed.
const SHARE: f32 = 0.25;

/// Cells of the graph's frame of which enough was observed, from the octants of the map's
/// visibility grid. `turn` takes the map's frame to the graph's.
pub(crate) fn looked(map: &Map, turn: &UnitQuaternion<f32>) -> Result<Looked, Error> {
    let grid = map.visibility();
    let half = grid.side() / 2.0;
    let mut counts: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    for cell in grid.cells() {
        for octant in (0..8).filter(|o| (cell.through | cell.surface) >> o & 1 == 1) {
            let p = [0, 1, 2].map(|k| {
                let upper = octant >> k & 1;
                (cell.key[k] * 2 + upper) as f32 * half + half / 2.0
            });
            let p = turn * Point3::from(p);
            *counts.entry([p.x, p.y, p.z].map(|v| (v / CELL).floor() as i32)).or_default() += 1;
        }
    }
    let enough = SHARE * (CELL / half).powi(3);
    let cells: Vec<[i32; 3]> = counts.into_iter().filter(|c| c.1 as f32 >= enough).map(|c| c.0).collect();
    Ok(Looked::new(CELL, [0.0; 3], &cells)?)
}

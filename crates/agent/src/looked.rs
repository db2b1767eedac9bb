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

#[cfg(test)]
mod tests {
    use super::*;
    use gsm::{DepthView, Intrinsics, Params};
    use nalgebra::{Isometry3, Vector3};

    /// A camera at the origin looks along z at a wall two metres off: what lies before the wall was seen,
    /// what lies behind it or beside the view was not, in whatever frame the graph stands.
    #[test]
    fn free_space_and_surfaces_are_seen_and_what_they_hide_is_not() {
        let intrinsics = Intrinsics::new(80.0, 80.0, 47.5, 35.5, 96, 72).expect("a camera");
        let depth = vec![2.0; 96 * 72];
        let mut map = Map::new(Params::default()).expect("defaults");
        for k in 0..4 {
            let world_from_camera = Isometry3::identity();
            map.integrate(&DepthView { depth: &depth, intrinsics, world_from_camera, time: f64::from(k) });
        }
        let quarter = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f32::consts::FRAC_PI_2);
        for turn in [UnitQuaternion::identity(), quarter] {
            let grid = looked(&map, &turn).expect("a small map");
            let seen = |x: f32, y: f32, z: f32| grid.contains(&(turn * Point3::new(x, y, z)));
            assert!(seen(0.1, 0.1, 1.2) && seen(0.3, -0.3, 1.7), "free space");
            assert!(seen(0.2, 0.2, 1.95), "the wall");
            assert!(!seen(0.1, 0.1, 3.2), "behind the wall");
            assert!(!seen(3.0, 0.1, 1.2) && !seen(0.1, 0.1, -1.2), "outside the view");
        }
    }
}

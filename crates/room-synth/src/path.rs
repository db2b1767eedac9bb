//! Hand-held camera paths: walking through the free part of a room, looking round.

use crate::mesh::Mesh;
use crate::rng::Draw;
use crate::room::{Room, Scan};
use crate::space::Obstacles;
use nalgebra::{
    Isometry3, Matrix3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// Frames per second.
pub(crate) const RATE: f32 = 5.0;
/// Side of a cell of the free-space grid, metres.
const CELL: f32 = 0.1;
/// Distance that the body keeps from things, metres.
const BODY: f32 = 0.18;

/// Where a person can stand.
struct Grid {
    free: Vec<bool>,
    width: usize,
    height: usize,
    origin: Point2<f32>,
}

impl Grid {
    fn new(room: &Room, scan: &Scan) -> Self {
        let lo = room.floor.iter().fold([f32::INFINITY; 2], |a, r| [a[0].min(r[0]), a[1].min(r[1])]);
        let hi = room.floor.iter().fold([f32::NEG_INFINITY; 2], |a, r| [a[0].max(r[2]), a[1].max(r[3])]);
        let (width, height) = (((hi[0] - lo[0]) / CELL) as usize + 1, ((hi[1] - lo[1]) / CELL) as usize + 1);
        let origin = Point2::new(lo[0], lo[1]);
        let boxes: Vec<_> = scan
            .instances
            .iter()
            .map(|i| (i.oriented_box(), i))
            .filter(|(b, i)| {
                let z = b.pose.translation.z;
                z - b.half[2] < 1.75
                    && z + b.half[2] > 0.25
                    && !matches!(i.label, "floor" | "wall" | "door" | "window" | "doorframe")
            })
            .map(|(b, _)| (b.pose.inverse(), b.half))
            .collect();
        let mut free = vec![false; width * height];
        for y in 0..height {
            for x in 0..width {
                let p = Point2::new(origin.x + (x as f32 + 0.5) * CELL, origin.y + (y as f32 + 0.5) * CELL);
                let inside = |q: Point2<f32>| {
                    room.floor.iter().any(|r| q.x > r[0] && q.x < r[2] && q.y > r[1] && q.y < r[3])
                };
                let room_for = [(0.0, 0.0), (BODY, 0.0), (-BODY, 0.0), (0.0, BODY), (0.0, -BODY)]
                    .iter()
                    .all(|&(dx, dy)| inside(Point2::new(p.x + dx, p.y + dy)));
                free[y * width + x] = room_for
                    && boxes.iter().all(|(inv, half)| {
                        let q = inv * Point3::new(p.x, p.y, inv.inverse().translation.z);
                        q.x.abs() > half[0] + BODY || q.y.abs() > half[1] + BODY
                    });
            }
        }
        Self { free, width, height, origin }
    }

    fn centre(&self, cell: usize) -> Point2<f32> {
        let (x, y) = (cell % self.width, cell / self.width);
        Point2::new(self.origin.x + (x as f32 + 0.5) * CELL, self.origin.y + (y as f32 + 0.5) * CELL)
    }

    fn neighbours(&self, cell: usize) -> impl Iterator<Item = usize> + '_ {
        let (x, y) = (cell % self.width, cell / self.width);
        [(0_i32, -1_i32), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)].into_iter().filter_map(
            move |(dx, dy)| {
                let (nx, ny) = (x.checked_add_signed(dx as isize)?, y.checked_add_signed(dy as isize)?);
                let n = ny * self.width + nx;
                (nx < self.width && ny < self.height && self.free[n]).then_some(n)
            },
        )
    }

    /// Steps from a cell to all that can be reached; `usize::MAX` elsewhere.
    fn steps(&self, from: usize) -> Vec<usize> {
        let mut steps = vec![usize::MAX; self.free.len()];
        steps[from] = 0;
        let mut queue = std::collections::VecDeque::from([from]);
        while let Some(c) = queue.pop_front() {
            for n in self.neighbours(c) {
                if steps[n] == usize::MAX {
                    steps[n] = steps[c] + 1;
                    queue.push_back(n);
                }
            }
        }
        steps
    }

    /// The largest connected free part.
    fn component(&self) -> Vec<usize> {
        let mut seen = vec![false; self.free.len()];
        let mut best = Vec::new();
        for start in 0..self.free.len() {
            if self.free[start] && !seen[start] {
                let part: Vec<usize> = self
                    .steps(start)
                    .iter()
                    .enumerate()
                    .filter(|(_, s)| **s < usize::MAX)
                    .map(|(k, _)| k)
                    .collect();
                for &c in &part {
                    seen[c] = true;
                }
                if part.len() > best.len() {
                    best = part;
                }
            }
        }
        best
    }
}

/// Points to walk, about `length` metres of them, a cell apart.
fn walk(grid: &Grid, draw: &mut Draw, length: f32, fallback: Point2<f32>) -> Vec<Point2<f32>> {
    let part = grid.component();
    if part.len() < 4 {
        return vec![fallback, fallback + Vector2::new(0.05, 0.05)];
    }
    let mut at = part[draw.below(part.len())];
    let mut out = vec![grid.centre(at)];
    while out.len() as f32 * CELL < length {
        let goal = part[draw.below(part.len())];
        let steps = grid.steps(goal);
        while at != goal {
            let Some(next) = grid.neighbours(at).min_by_key(|&n| steps[n]) else { break };
            at = next;
            out.push(grid.centre(at));
        }
        if part.len() < 2 {
            break;
        }
    }
    out
}

/// A camera path in the room's layout frame: one pose per frame. Camera: z forward, world-up
/// about -x (the phone is held upright, its images lie on their side).
pub(crate) fn path(room: &Room, scan: &Scan, draw: &mut Draw, mean_frames: f32) -> Vec<Isometry3<f32>> {
    let spread = mean_frames * 0.22;
    let n =
        (mean_frames + spread * draw.normal()).clamp(mean_frames * 0.45, mean_frames * 1.9).round() as usize;
    let speed = draw.range(0.2, 0.4);
    let grid = Grid::new(room, scan);
    let obstacles = obstacles(scan);
    let (cx, cy) = middle(&room.floor);
    let points = walk(&grid, draw, n as f32 / RATE * speed + 0.5, Point2::new(cx, cy));
    let radius = room.floor.iter().fold(1.0_f32, |a, r| a.max(r[2] - cx).max(r[3] - cy));
    let height = draw.range(1.35, 1.6);
    let mut look = Look::new(draw);
    let mut position = points[0];
    let mut walked = 0.0_f32;
    let mut out = Vec::with_capacity(n);
    for k in 0..n {
        let pause = if (k / 40) % 3 == 2 { 0.3 } else { 1.0 };
        walked += speed / RATE * pause;
        let goal = points[((walked / CELL) as usize).min(points.len() - 1)];
        // Following a point behind the corner rounds the corner.
        position += (goal - position) * 0.35;
        let t = k as f32 / RATE;
        let bob = 0.03 * (t * 2.1).sin();
        let eye = Point3::new(position.x, position.y, height + bob + 0.1 * (t * 0.23).sin());
        let at =
            |theta: f32, aim: f32| Point3::new(cx + radius * theta.cos(), cy + radius * theta.sin(), aim);
        let (theta, aim) = look.step(draw, |theta| {
            let along = (at(theta, eye.z - 0.3) - eye).normalize();
            obstacles.cast(&eye, &along, 5.0).unwrap_or(f32::INFINITY)
        });
        let target = at(theta, aim);
        out.push(camera(&eye, &target, look.roll));
    }
    out
}

/// All that stops the gaze, in the layout frame.
fn obstacles(scan: &Scan) -> Obstacles {
    let mut all = Mesh::default();
    for i in &scan.instances {
        all.append(&i.mesh().transformed(&i.room_from_object));
    }
    Obstacles::new(&all)
}

fn middle(floor: &[[f32; 4]]) -> (f32, f32) {
    let area: f32 = floor.iter().map(|r| (r[2] - r[0]) * (r[3] - r[1])).sum();
    let sum = floor.iter().fold((0.0, 0.0), |a, r| {
        let w = (r[2] - r[0]) * (r[3] - r[1]) / area;
        (a.0 + w * (r[0] + r[2]) / 2.0, a.1 + w * (r[1] + r[3]) / 2.0)
    });
    (sum.0, sum.1)
}

/// Where the person looks: round the room, up and down.
struct Look {
    theta: f32,
    rate: f32,
    goal_rate: f32,
    aim: f32,
    goal_aim: f32,
    roll: f32,
    /// The gaze stays within `reach` of `middle`: some visits leave a part of the room out.
    middle: f32,
    reach: f32,
}

impl Look {
    fn new(draw: &mut Draw) -> Self {
        let rate = draw.range(0.25, 0.5) * if draw.chance(0.5) { 1.0 } else { -1.0 };
        let middle = draw.range(0.0, std::f32::consts::TAU);
        let reach = draw.range(1.7, 5.0);
        Self { theta: middle, rate, goal_rate: rate, aim: 0.7, goal_aim: 0.7, roll: 0.0, middle, reach }
    }

    /// Angle about the middle of the room, and height of the point looked at.
    fn step(&mut self, draw: &mut Draw, distance: impl Fn(f32) -> f32) -> (f32, f32) {
        if draw.chance(0.04) {
            let sign = if draw.chance(0.75) { self.goal_rate.signum() } else { -self.goal_rate.signum() };
            self.goal_rate = sign * draw.range(0.15, 0.6);
        }
        if draw.chance(0.08) {
            self.goal_aim = draw.range(-0.5, 1.7);
        }
        // Nobody films the wall before his nose, or nothing at all: the gaze hurries over it.
        let hurry = match distance(self.theta) {
            d if d < 1.0 => 2.4,
            d if d > 4.8 => 3.0,
            _ => 1.0,
        };
        if (self.theta - self.middle).abs() > self.reach && (self.theta - self.middle) * self.goal_rate > 0.0
        {
            self.goal_rate = -self.goal_rate;
        }
        self.rate += 0.15 * (self.goal_rate - self.rate);
        self.aim += 0.12 * (self.goal_aim - self.aim);
        self.roll = 0.97 * self.roll + 0.008 * draw.normal();
        self.theta += self.rate * hurry / RATE;
        (self.theta, self.aim)
    }
}

/// The pose of a camera that looks from `eye` to `target`, held sideways.
pub(crate) fn camera(eye: &Point3<f32>, target: &Point3<f32>, roll: f32) -> Isometry3<f32> {
    let forward = (target - eye).try_normalize(1e-4).unwrap_or_else(Vector3::x);
    let left = Vector3::z().cross(&forward).try_normalize(1e-4).unwrap_or_else(Vector3::y);
    let up = forward.cross(&left);
    let axes = Matrix3::from_columns(&[-up, left, forward]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
    Isometry3::from_parts(Translation3::from(eye.coords), rotation * roll)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_is_right_handed_looks_forward_and_lies_on_its_side() {
        let pose = camera(&Point3::new(1.0, 2.0, 1.5), &Point3::new(3.0, 2.0, 1.5), 0.0);
        assert!((pose * Vector3::z() - Vector3::x()).norm() < 1e-5);
        assert!((pose * Vector3::x() + Vector3::z()).norm() < 1e-5, "world-up is -x of the camera");
        let m = pose.rotation.to_rotation_matrix();
        assert!((m.matrix().determinant() - 1.0).abs() < 1e-5);
    }
}

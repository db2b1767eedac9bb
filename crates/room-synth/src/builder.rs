//! Puts objects into a room so that nothing floats and nothing overlaps.

use crate::catalogue::{self, Kind, Place};
use crate::plan::{Plan, WallLine, facing};
use crate::relations::Contact;
use crate::rng::Draw;
use crate::room::{Geometry, Instance, Support};
use crate::shapes::{Family, Shape};
use crate::space::Solid;
use crate::split::Split;
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// Id of the floor; walls follow.
pub(crate) const FLOOR: u32 = 1;
/// Attempts per object and place before it is left out.
const TRIES: usize = 24;
/// Gap left between neighbours, metres.
const GAP: f32 = 0.012;

/// A room under construction.
pub(crate) struct Builder {
    pub(crate) draw: Draw,
    pub(crate) split: Split,
    pub(crate) plan: Plan,
    pub(crate) out: Vec<Instance>,
    solids: Vec<(u32, Solid)>,
    /// Places that must stay free: before doors.
    keep_out: Vec<Solid>,
    /// Ids of the walls of `plan.walls`, 0 where open; id of the ceiling.
    pub(crate) wall_ids: Vec<u32>,
    /// Ids of the upper pieces of walls in two pieces, 0 elsewhere.
    pub(crate) upper_ids: Vec<u32>,
    pub(crate) ceiling: Option<u32>,
    models: BTreeMap<&'static str, Vec<(Shape, u64)>>,
    pub(crate) next_id: u32,
}

impl Builder {
    pub(crate) fn new(draw: Draw, split: Split, plan: Plan) -> Self {
        Self {
            draw,
            split,
            plan,
            out: Vec::new(),
            solids: Vec::new(),
            keep_out: Vec::new(),
            wall_ids: Vec::new(),
            upper_ids: Vec::new(),
            ceiling: None,
            models: BTreeMap::new(),
            next_id: FLOOR,
        }
    }

    /// A shape of that kind: new, or a copy of one that the room already has.
    pub(crate) fn shape(&mut self, kind: &Kind, only: Option<Family>) -> (Shape, u64) {
        let copies = ["chair", "dining chair", "stool", "bench", "armchair", "nightstand", "kitchen cabinet"];
        let rate = if copies.contains(&kind.label) { 0.8 } else { 0.12 };
        if let Some(known) = self.models.get(kind.label) {
            let fitting: Vec<&(Shape, u64)> =
                known.iter().filter(|m| only.is_none_or(|f| m.0.family == f)).collect();
            if !fitting.is_empty() && self.draw.chance(rate) {
                return fitting[self.draw.below(fitting.len())].clone();
            }
        }
        let options: Vec<_> = kind.shapes.iter().filter(|s| only.is_none_or(|f| s.0 == f)).collect();
        let (family, mean) =
            if options.is_empty() { kind.shapes[0] } else { *options[self.draw.below(options.len())] };
        let shape = self.fresh(family, mean, kind.spread);
        let model = self.draw.word() | 1;
        self.models.entry(kind.label).or_default().push((shape.clone(), model));
        (shape, model)
    }

    /// A shape with sizes about a mean: `spread` is the standard deviation of their logarithm.
    pub(crate) fn fresh(&mut self, family: Family, mean: [f32; 3], spread: f32) -> Shape {
        let (split, draw) = (self.split, &mut self.draw);
        let mut size = mean;
        for (k, extent) in size.iter_mut().enumerate() {
            // Heights follow people and vary less.
            let sd = if k == 2 { 0.78 * spread } else { spread };
            *extent *= (1.75 * sd * (2.0 * split.position(draw) - 1.0)).exp();
        }
        if matches!(
            family,
            Family::StoolRound | Family::TableRound | Family::Bottle | Family::Vase | Family::Plate
        ) || matches!(family, Family::FloorLamp | Family::TableLamp | Family::Pendant)
        {
            size[1] = size[0];
        }
        Shape { family, size, style: [0; 4].map(|_| split.position(draw)), detail: draw.word() }
    }

    pub(crate) fn fits(
        &self,
        pose: &Isometry3<f32>,
        size: [f32; 3],
        ignore: &[u32],
        slack: f32,
    ) -> Option<Solid> {
        let [w, d, h] = size;
        for (x, y) in [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (0.0, 0.0)] {
            let c = pose * Point3::new(x * w, y * d, 0.0);
            if !self.plan.contains(&Point2::new(c.x, c.y), 0.004) {
                return None;
            }
        }
        if pose.translation.z + h > self.plan.height + 0.01 {
            return None;
        }
        let centre = pose * Translation3::new(0.0, 0.0, h / 2.0);
        let half = [(w + slack) / 2.0, (d + slack) / 2.0, (h / 2.0 - 0.004).max(0.002)];
        let solid = Solid::new(&centre, half);
        let clash = self.solids.iter().any(|(id, s)| !ignore.contains(id) && s.overlaps(&solid))
            || pose.translation.z < 1.9 && self.keep_out.iter().any(|s| s.overlaps(&solid));
        (!clash).then_some(solid)
    }

    pub(crate) fn keep_free(&mut self, pose: &Isometry3<f32>, half: [f32; 3]) {
        self.keep_out.push(Solid::new(pose, half));
    }

    /// Adds an instance without asking whether it fits.
    pub(crate) fn add(
        &mut self,
        label: &'static str,
        geometry: Geometry,
        pose: Isometry3<f32>,
        supports: Vec<Support>,
        albedo: f32,
    ) -> u32 {
        let id = self.next_id;
        self.next_id += 1;
        let model = self.draw.word() | 1;
        let symmetry = symmetry(&geometry);
        let instance = Instance {
            id,
            label,
            geometry,
            room_from_object: pose,
            supports,
            model,
            albedo,
            annotated: true,
            symmetry,
        };
        self.out.push(instance);
        id
    }

    /// Registers the box of an added instance as occupied.
    pub(crate) fn occupy(&mut self, id: u32) {
        if let Some(i) = self.out.iter().find(|i| i.id == id) {
            let b = i.oriented_box();
            self.solids.push((id, Solid::new(&b.pose, b.half)));
        }
    }

    /// Tries to put one more object of a label somewhere; its id.
    pub(crate) fn place(&mut self, label: &str) -> Option<u32> {
        let kind = catalogue::find(label)?;
        for _ in 0..4 {
            let (shape, model) = self.shape(kind, None);
            let k = self.draw.weighted(kind.places.iter().map(|p| p.0));
            if let Some(id) =
                self.place_at(kind, &shape, model, place_for(kind.label, shape.family, kind.places[k].1))
            {
                return Some(id);
            }
        }
        None
    }

    /// Tries to put that shape at that kind of place.
    pub(crate) fn place_at(&mut self, kind: &Kind, shape: &Shape, model: u64, place: Place) -> Option<u32> {
        for _ in 0..TRIES {
            let mut shape = shape.clone();
            let Some((pose, supports, ignore)) = self.candidate(kind, &mut shape, place) else { continue };
            let slack = if ignore.is_empty() { GAP } else { -GAP };
            let Some(solid) = self.fits(&pose, shape.size, &ignore, slack) else { continue };
            let albedo = (kind.albedo * self.draw.range(0.5, 1.4)).clamp(0.05, 1.0);
            let id = self.add(kind.label, Geometry::Shape(shape), pose, supports, albedo);
            if let Some(i) = self.out.last_mut() {
                i.model = model;
            }
            self.solids.push((id, solid));
            return Some(id);
        }
        None
    }

    /// A pose, its supports, and the hosts whose boxes it may enter.
    fn candidate(
        &mut self,
        kind: &Kind,
        shape: &mut Shape,
        place: Place,
    ) -> Option<(Isometry3<f32>, Vec<Support>, Vec<u32>)> {
        let floor = vec![Support { parent: FLOOR, contact: kind.floor }];
        let [w, d, h] = shape.size;
        match place {
            Place::Back => Some((self.back(shape)?, floor, vec![])),
            Place::Free => {
                let p = self.point();
                let yaw = self.draw.range(-3.2, 3.2);
                Some((upright(p, yaw, 0.0), floor, vec![]))
            }
            Place::Around(hosts) => self.around(hosts, shape).map(|(p, host)| (p, floor, vec![host])),
            Place::Beside(hosts) => self.beside(hosts, shape).map(|p| (p, floor, vec![])),
            Place::Before(hosts) => self.before(hosts, shape).map(|p| (p, floor, vec![])),
            Place::On(hosts, contact) => self
                .on(hosts, shape, false)
                .map(|(p, host)| (p, vec![Support { parent: host, contact }], vec![host])),
            Place::In(hosts, contact) => self
                .on(hosts, shape, true)
                .map(|(p, host)| (p, vec![Support { parent: host, contact }], vec![host])),
            Place::Wall(low, high, contact) => {
                let (k, wall) = self.wall()?;
                let u = self.draw.range(w / 2.0, (wall.length() - w / 2.0).max(w / 2.0));
                let z = (self.draw.range(low, high) - h / 2.0)
                    .clamp(0.03, (self.plan.height - h - 0.02).max(0.03));
                if wall
                    .holes
                    .iter()
                    .any(|q| u + w / 2.0 > q[0] && u - w / 2.0 < q[1] && z + h > q[2] && z < q[3])
                {
                    return None;
                }
                let parent = self.wall_at(k, z + h / 2.0);
                Some((wall.pose(u, 0.004, d, z), vec![Support { parent, contact }], vec![]))
            }
            Place::Lean => self.lean(shape),
            Place::Ceiling => {
                let parent = self.ceiling?;
                let p = self.point();
                let yaw = if self.draw.chance(0.7) { 0.0 } else { self.draw.range(-1.5, 1.5) };
                Some((
                    upright(p, yaw, self.plan.height - h),
                    vec![Support { parent, contact: Contact::HangingOn }],
                    vec![],
                ))
            }
        }
    }

    /// At a wall, its back to it; long things now and then with their side.
    fn back(&mut self, shape: &Shape) -> Option<Isometry3<f32>> {
        let [mut w, mut d, _] = shape.size;
        let (_, wall) = self.wall()?;
        let side = d > 1.25 * w && self.draw.chance(0.5);
        if side {
            std::mem::swap(&mut w, &mut d);
        }
        let u = self.draw.range(w / 2.0, (wall.length() - w / 2.0).max(w / 2.0));
        let snapped = if self.draw.chance(0.35) { w / 2.0 + 0.02 } else { u };
        let gap = 0.01 + 0.04 * self.draw.unit() * self.draw.unit();
        let mut pose = wall.pose(snapped, gap, d, 0.0);
        if side {
            let quarter = if self.draw.chance(0.5) { 1.0 } else { -1.0 } * std::f32::consts::FRAC_PI_2;
            pose.rotation *= UnitQuaternion::from_axis_angle(&Vector3::z_axis(), quarter);
        }
        Some(self.jitter(pose, 1.5))
    }

    /// The piece of a wall at some height.
    pub(crate) fn wall_at(&self, k: usize, z: f32) -> u32 {
        let upper = self.upper_ids.get(k).copied().unwrap_or(0);
        if upper > 0 && self.plan.walls[k].cut.is_some_and(|c| z > c) { upper } else { self.wall_ids[k] }
    }

    fn wall(&mut self) -> Option<(usize, WallLine)> {
        let closed: Vec<usize> = (0..self.plan.walls.len()).filter(|&k| !self.plan.walls[k].open).collect();
        if closed.is_empty() {
            return None;
        }
        let k = closed[self.draw.weighted(closed.iter().map(|&k| self.plan.walls[k].length()))];
        Some((k, self.plan.walls[k].clone()))
    }

    /// A point of the floor.
    pub(crate) fn point(&mut self) -> Point2<f32> {
        let area = |r: &[f32; 4]| (r[2] - r[0]) * (r[3] - r[1]);
        let r = self.plan.rects[self.draw.weighted(self.plan.rects.iter().map(area))];
        Point2::new(self.draw.range(r[0], r[2]), self.draw.range(r[1], r[3]))
    }

    /// Turns a pose by a few degrees, as people leave things.
    fn jitter(&mut self, pose: Isometry3<f32>, degrees: f32) -> Isometry3<f32> {
        let turn =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.draw.normal() * degrees.to_radians());
        Isometry3::from_parts(pose.translation, pose.rotation * turn)
    }

    /// A host of one of those labels, as (id, pose, size).
    fn host(&mut self, labels: &[&str]) -> Option<(u32, Isometry3<f32>, [f32; 3])> {
        let ids: Vec<usize> = (0..self.out.len()).filter(|&k| labels.contains(&self.out[k].label)).collect();
        if ids.is_empty() {
            return None;
        }
        let i = &self.out[ids[self.draw.below(ids.len())]];
        Some((i.id, i.room_from_object, i.size()))
    }

    /// At one of the sides of a table, facing it, partly under it.
    fn around(&mut self, hosts: &[&str], shape: &Shape) -> Option<(Isometry3<f32>, u32)> {
        let (id, pose, [w, d, _]) = self.host(hosts)?;
        let under = self.draw.range(0.05, 0.25).min(shape.size[1] * 0.4);
        let long = self.draw.chance(w / (w + d));
        let sign = if self.draw.chance(0.5) { 1.0 } else { -1.0 };
        let along = self.draw.range(-0.42, 0.42);
        let reach = |half: f32| sign * (half + shape.size[1] / 2.0 - under);
        let (x, y) = if long { (along * w, reach(d / 2.0)) } else { (reach(w / 2.0), along * d) };
        let p = pose * Point3::new(x, y, 0.0);
        let towards =
            pose.rotation * if long { Vector3::new(0.0, -sign, 0.0) } else { Vector3::new(-sign, 0.0, 0.0) };
        let turn = if self.draw.chance(0.7) { 6.0 } else { 28.0 };
        Some((self.jitter(facing(Point2::new(p.x, p.y), towards.xy(), 0.0), turn), id))
    }

    fn beside(&mut self, hosts: &[&str], shape: &Shape) -> Option<Isometry3<f32>> {
        let (_, pose, [w, d, _]) = self.host(hosts)?;
        let sign = if self.draw.chance(0.5) { 1.0 } else { -1.0 };
        let x = sign * (w / 2.0 + shape.size[0] / 2.0 + self.draw.range(0.02, 0.15));
        let y = (shape.size[1] - d) / 2.0 + self.draw.range(0.0, 0.06);
        let p = pose * Point3::new(x, y, 0.0);
        Some(self.jitter(Isometry3::from_parts(Translation3::new(p.x, p.y, 0.0), pose.rotation), 3.0))
    }

    fn before(&mut self, hosts: &[&str], shape: &Shape) -> Option<Isometry3<f32>> {
        let (_, pose, [w, d, _]) = self.host(hosts)?;
        let y = d / 2.0 + shape.size[1] / 2.0 + self.draw.range(0.25, 0.7);
        let p = pose * Point3::new(self.draw.range(-0.3, 0.3) * w, y, 0.0);
        Some(self.jitter(Isometry3::from_parts(Translation3::new(p.x, p.y, 0.0), pose.rotation), 6.0))
    }

    /// On or in a host. A thing that is too high for its board is made lower.
    fn on(&mut self, hosts: &[&str], shape: &mut Shape, inside: bool) -> Option<(Isometry3<f32>, u32)> {
        let labels: Vec<usize> =
            (0..self.out.len()).filter(|&k| hosts.contains(&self.out[k].label)).collect();
        if labels.is_empty() {
            return None;
        }
        let host = &self.out[labels[self.draw.below(labels.len())]];
        let (id, pose) = (host.id, host.room_from_object);
        let places: Vec<_> =
            host.surfaces().into_iter().filter(|s| s.inside == inside && s.z < 2.0).collect();
        if places.is_empty() {
            return None;
        }
        let s = places[self.draw.below(places.len())];
        let [w, d, h] = shape.size;
        if h > s.clearance * 0.95 || w > s.size[0] || d > s.size[1] {
            let soft = matches!(
                shape.family,
                Family::Pillow
                    | Family::Blanket
                    | Family::Clothes
                    | Family::Block
                    | Family::OpenBox
                    | Family::Heap
            );
            let narrow = |v: f32, room: f32| v.min(room * 0.95);
            if !(inside || soft) || s.clearance < 0.06 || s.size[0] < 0.08 || s.size[1] < 0.08 {
                return None;
            }
            let squeezed = [narrow(w, s.size[0]), narrow(d, s.size[1]), narrow(h, s.clearance)];
            if squeezed.iter().zip(shape.size).any(|(a, b)| *a < 0.45 * b) {
                return None;
            }
            shape.size = squeezed;
        }
        let [w, d, _] = shape.size;
        let free = [(s.size[0] - w).max(0.0), (s.size[1] - d).max(0.0)];
        let x = s.centre[0] + free[0] * self.draw.range(-0.5, 0.5);
        // Things stand towards the back, where the wall is.
        let y = s.centre[1]
            + free[1] * if inside { self.draw.range(-0.4, 0.5) } else { self.draw.range(-0.5, 0.35) };
        let local = Isometry3::from_parts(Translation3::new(x, y, s.z + 0.001), UnitQuaternion::identity());
        let turn = if inside { 2.0 } else { 9.0 };
        Some((self.jitter(pose * local, turn), id))
    }

    fn lean(&mut self, shape: &Shape) -> Option<(Isometry3<f32>, Vec<Support>, Vec<u32>)> {
        let [w, d, h] = shape.size;
        let (k, wall) = self.wall()?;
        let tilt = self.draw.range(0.12, 0.3);
        let u = self.draw.range(w / 2.0, (wall.length() - w / 2.0).max(w / 2.0));
        // The top back edge touches the wall.
        let gap = h * tilt.sin() + 0.01;
        let pose = wall.pose(u, gap, d, 0.0);
        let rotation = pose.rotation * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), tilt);
        let lift = d / 2.0 * tilt.sin();
        let pose =
            Isometry3::from_parts(Translation3::new(pose.translation.x, pose.translation.y, lift), rotation);
        let wall_id = self.wall_ids[k];
        let supports = vec![
            Support { parent: wall_id, contact: Contact::LeaningAgainst },
            Support { parent: FLOOR, contact: Contact::StandingOn },
        ];
        Some((pose, supports, vec![]))
    }
}

/// A pose with a yaw.
pub(crate) fn upright(p: Point2<f32>, yaw: f32, z: f32) -> Isometry3<f32> {
    Isometry3::from_parts(
        Translation3::new(p.x, p.y, z),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw),
    )
}

/// Where some shapes have to go whatever their label says.
fn place_for(label: &str, family: Family, drawn: Place) -> Place {
    const TOPS: &[&str] = &["nightstand", "desk", "table", "commode", "side table", "windowsill", "tv stand"];
    match (label, family) {
        ("lamp", Family::TableLamp) => Place::On(TOPS, Contact::StandingOn),
        ("lamp", Family::FloorLamp) => Place::Back,
        ("lamp", Family::Pendant) => Place::Ceiling,
        ("lamp", Family::Disc) => Place::Wall(1.5, 2.0, Contact::HangingOn),
        (_, Family::Hanging) => Place::Wall(1.1, 1.6, Contact::HangingOn),
        ("clothes" | "towel", Family::Clothes) if matches!(drawn, Place::Wall(..)) => {
            Place::On(&["chair", "bed", "bath cabinet", "washing machine"], Contact::LyingOn)
        }
        ("mirror", _) if drawn == Place::Back => Place::Lean,
        ("shelf", Family::WallBoard) => Place::Wall(1.1, 1.8, Contact::AttachedTo),
        _ => drawn,
    }
}

/// Symmetry about the upright axis, as in `3RScan.json`.
pub(crate) fn symmetry(geometry: &Geometry) -> u8 {
    let Geometry::Shape(s) = geometry else { return 0 };
    match s.family {
        Family::StoolRound | Family::TableRound | Family::Bottle | Family::Vase | Family::Plate => 3,
        Family::Bin | Family::Basket | Family::Pot if (s.size[0] - s.size[1]).abs() < 0.03 => 3,
        Family::FloorLamp | Family::TableLamp | Family::Pendant => 3,
        Family::Stool | Family::Ottoman if (s.size[0] - s.size[1]).abs() < 0.03 => 2,
        Family::Table
        | Family::TableShelf
        | Family::Bench
        | Family::Stool
        | Family::Block
        | Family::Pillow
        | Family::Ottoman => 1,
        _ => 0,
    }
}

/// Going on with a room that is already furnished.
impl Builder {
    pub(crate) fn resume(draw: Draw, split: Split, layout: &crate::layout::Layout, next_id: u32) -> Self {
        let mut b = Self::new(draw, split, layout.plan.clone());
        b.out.clone_from(&layout.instances);
        b.next_id = next_id;
        b.wall_ids.clone_from(&layout.wall_ids);
        b.upper_ids.clone_from(&layout.upper_ids);
        b.ceiling = layout.ceiling;
        b.keep_out.clone_from(&layout.keep_out);
        let building = ["floor", "wall", "ceiling", "window", "door", "doorframe"];
        let ids: Vec<u32> = b.out.iter().filter(|i| !building.contains(&i.label)).map(|i| i.id).collect();
        for id in ids {
            b.occupy(id);
        }
        b
    }

    /// Ends the building of a room.
    pub(crate) fn finish(self, kind: &'static str) -> crate::layout::Layout {
        let mut instances = self.out;
        instances.sort_by_key(|i| i.id);
        crate::layout::Layout {
            kind,
            plan: self.plan,
            instances,
            next_id: self.next_id,
            wall_ids: self.wall_ids,
            upper_ids: self.upper_ids,
            ceiling: self.ceiling,
            keep_out: self.keep_out,
        }
    }

    /// Frees the place of an instance.
    pub(crate) fn vacate(&mut self, id: u32) {
        self.solids.retain(|(k, _)| *k != id);
    }

    /// What already stands partly in the box of an instance: chairs under a table, things on it.
    pub(crate) fn overlapping(&self, id: u32) -> Vec<u32> {
        let Some((_, own)) = self.solids.iter().find(|(k, _)| *k == id) else { return Vec::new() };
        self.solids.iter().filter(|(k, s)| *k != id && s.overlaps(own)).map(|(k, _)| *k).collect()
    }

    pub(crate) fn set_pose(&mut self, id: u32, pose: Isometry3<f32>) {
        if let Some(i) = self.out.iter_mut().find(|i| i.id == id) {
            i.room_from_object = pose;
        }
        if self.solids.iter().any(|(k, _)| *k == id) {
            self.vacate(id);
            self.occupy(id);
        }
    }
}

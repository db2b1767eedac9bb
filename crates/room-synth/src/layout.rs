//! From a room type to a furnished room.

use crate::builder::{Builder, FLOOR};
use crate::catalogue;
use crate::openings;
use crate::plan::{Plan, WallLine, facing};
use crate::recipes::{CLUTTER, RECIPES, Recipe};
use crate::relations::Contact;
use crate::rng::Draw;
use crate::room::{Geometry, Instance, Support};
use crate::shapes::Family;
use crate::space::Solid;
use crate::split::Split;
use nalgebra::{Isometry3, Translation3};
use std::sync::Arc;

/// A furnished room in its layout frame.
pub(crate) struct Layout {
    pub(crate) kind: &'static str,
    pub(crate) plan: Plan,
    pub(crate) instances: Vec<Instance>,
    pub(crate) next_id: u32,
    pub(crate) wall_ids: Vec<u32>,
    pub(crate) upper_ids: Vec<u32>,
    pub(crate) ceiling: Option<u32>,
    pub(crate) keep_out: Vec<Solid>,
}

/// Furnishes the room of that index.
pub(crate) fn layout(seed: u64, split: Split, index: u64) -> Layout {
    let mut draw = Draw::new(seed, "room", &[split as u64, index]);
    let recipe = &RECIPES[draw.weighted(RECIPES.iter().map(|r| r.weight))];
    // Some rooms are nearly empty, some are crammed.
    let richness = (0.5 * draw.normal() - 0.02).exp().clamp(0.22, 3.6);
    let side = 0.95 * richness.powf(0.3);
    let w = draw.range(recipe.sides[0], recipe.sides[1]) * side;
    let l = draw.range(recipe.sides[0], recipe.sides[1]) * side * draw.range(1.0, 1.45);
    let plan = Plan::draw(&mut draw, w.max(1.5), l.max(1.6), richness);
    let mut b = Builder::new(draw, split, plan);
    shell(&mut b);
    openings::doors(&mut b, recipe.doors);
    openings::windows(&mut b, recipe.windows);
    walls(&mut b);
    openings::fill(&mut b);
    if recipe.kitchen > 0.0 && b.draw.chance(recipe.kitchen) {
        kitchen_run(&mut b);
    }
    if recipe.sink > 0.0 && b.draw.chance(recipe.sink) {
        wash_place(&mut b);
    }
    furnish(&mut b, recipe, richness);
    shower_curtain(&mut b);
    b.finish(recipe.kind)
}

/// Floor, walls without mesh yet, ceiling.
fn shell(b: &mut Builder) {
    let (mesh, size) = b.plan.slab(true);
    b.add("floor", Geometry::Built(Arc::new(mesh), size), Isometry3::translation(0.0, 0.0, 0.0), vec![], 0.6);
    // Wall ids come next, in order, so that what is attached to walls can name them.
    b.wall_ids = b.plan.walls.iter().map(|w| if w.open { 0 } else { 1 }).collect();
    for id in b.wall_ids.iter_mut().filter(|id| **id > 0) {
        *id = b.next_id;
        b.next_id += 1;
    }
    b.upper_ids = vec![0; b.wall_ids.len()];
    for k in 0..b.upper_ids.len() {
        if b.wall_ids[k] > 0 && b.plan.walls[k].cut.is_some() {
            b.upper_ids[k] = b.next_id;
            b.next_id += 1;
        }
    }
    let (mesh, size) = b.plan.slab(false);
    let Some(&first) = b.wall_ids.iter().find(|id| **id > 0) else { return };
    let supports = vec![Support { parent: first, contact: Contact::AttachedTo }];
    let pose = Isometry3::translation(0.0, 0.0, b.plan.height);
    let id = b.add("ceiling", Geometry::Built(Arc::new(mesh), size), pose, supports, 0.85);
    b.ceiling = Some(id);
    let seen = b.draw.chance(0.84);
    if let Some(i) = b.out.last_mut() {
        i.annotated = seen;
    }
}

/// Walls with the holes that doors and windows made, in one piece or two.
fn walls(b: &mut Builder) {
    for (k, line) in b.plan.walls.clone().iter().enumerate() {
        if line.open {
            continue;
        }
        let (id, upper) = (b.wall_ids[k], b.upper_ids[k]);
        let cut = if upper > 0 { line.cut } else { None }.unwrap_or(b.plan.height);
        wall_piece(b, line, id, FLOOR, [0.0, cut]);
        if upper > 0 {
            wall_piece(b, line, upper, id, [cut, b.plan.height]);
        }
    }
    b.out.sort_by_key(|i| i.id);
}

fn wall_piece(b: &mut Builder, line: &WallLine, id: u32, parent: u32, [bottom, top]: [f32; 2]) {
    let size = [line.length(), line.thickness, top - bottom];
    let middle = line.a + (line.b - line.a) / 2.0 - line.inward * (line.thickness / 2.0);
    let geometry = Geometry::Built(Arc::new(line.mesh(bottom, top)), size);
    let supports = vec![Support { parent, contact: Contact::AttachedTo }];
    let albedo = b.draw.range(0.65, 0.95);
    let next = b.next_id;
    b.add("wall", geometry, facing(middle, line.inward, bottom), supports, albedo);
    b.next_id = next;
    if let Some(i) = b.out.last_mut() {
        i.id = id;
    }
}

/// Kitchen cabinets in a row under a counter with a sink, wall cabinets above.
fn kitchen_run(b: &mut Builder) {
    let Some(cabinet) = catalogue::find("cabinet") else { return };
    let lengths: Vec<f32> = b.plan.walls.iter().map(|w| if w.open { 0.0 } else { w.length() }).collect();
    let k = b.draw.weighted(lengths.iter().map(|l| (l - 1.2).max(0.01).powi(2)));
    let line = b.plan.walls[k].clone();
    if line.open || line.length() < 1.2 {
        return;
    }
    let wall_id = b.wall_ids[k];
    let (depth, top) = (b.draw.range(0.52, 0.66), b.draw.range(0.72, 0.82));
    let label = if b.draw.chance(0.85) { "kitchen cabinet" } else { "cabinet" };
    let total = (line.length() - 0.1).min(b.draw.range(1.4, 3.4));
    let start = if b.draw.chance(0.6) { 0.05 } else { (line.length() - total) * b.draw.unit() };
    let n = (total / b.draw.range(0.9, 1.9)).round().max(1.0);
    let width = total / n;
    let mut bases = Vec::new();
    for c in 0..n as u32 {
        let family = if b.draw.chance(0.5) { Family::Cabinet } else { Family::Drawers };
        let mut shape = b.fresh(family, [width, depth, top], 0.0);
        shape.size = [width - 0.012, depth, top];
        let pose = line.pose(start + width * (c as f32 + 0.5), 0.01, depth, 0.0);
        let supports = vec![Support { parent: FLOOR, contact: Contact::StandingOn }];
        if let Some(id) = fixed(b, label, Geometry::Shape(shape), pose, supports, cabinet.albedo, &[]) {
            bases.push((id, start + width * c as f32));
        }
    }
    let Some(&(first, u0)) = bases.first() else { return };
    counter(b, &line, &bases, u0, width, depth, top);
    let upper = [width - 0.012, b.draw.range(0.3, 0.38), b.draw.range(0.5, 0.8)];
    for &(_, u) in &bases {
        let u = u + width / 2.0;
        let blocked =
            line.holes.iter().any(|h| u + width / 2.0 > h[0] && u - width / 2.0 < h[1] && h[3] > 1.4);
        if blocked || !b.draw.chance(0.6) {
            continue;
        }
        let mut shape = b.fresh(Family::Cabinet, upper, 0.0);
        shape.size = upper;
        let pose = line.pose(u, 0.005, upper[1], 1.45);
        fixed(
            b,
            label,
            Geometry::Shape(shape),
            pose,
            vec![Support { parent: wall_id, contact: Contact::AttachedTo }],
            0.7,
            &[],
        );
    }
    if b.draw.chance(0.3) {
        let shape = b.fresh(Family::Oven, [0.56, 0.03, 0.5], 0.0);
        let pose = line.pose(u0 + width / 2.0, depth + 0.012, 0.03, 0.14);
        fixed(
            b,
            "oven",
            Geometry::Shape(shape),
            pose,
            vec![Support { parent: first, contact: Contact::BuiltIn }],
            0.2,
            &[first],
        );
    }
}

/// The counter over a row of cabinets: a slab with a hole for the sink.
fn counter(
    b: &mut Builder,
    line: &WallLine,
    bases: &[(u32, f32)],
    u0: f32,
    width: f32,
    depth: f32,
    top: f32,
) {
    let Some(&(last, u1)) = bases.last() else { return };
    let (length, thick) = (u1 + width - u0, b.draw.range(0.06, 0.27));
    let middle = u0 + length / 2.0;
    let pose = line.pose(middle, 0.005, depth + 0.02, top + 0.002);
    let hole = (length > 0.8 && b.draw.chance(0.72)).then(|| {
        let w = b.draw.range(0.38, 0.5);
        let x = b.draw.range(-0.5, 0.5) * (length - w - 0.2);
        [x, -0.02, w, depth * 0.7]
    });
    let mesh = slab_with_hole([length, depth + 0.02, thick], hole);
    let label = if b.draw.chance(0.6) { "kitchen counter" } else { "counter" };
    let part = if b.draw.chance(0.6) { Contact::PartOf } else { Contact::SupportedBy };
    let supports = bases.iter().take(1).map(|&(parent, _)| Support { parent, contact: part }).collect();
    let geometry = Geometry::Built(Arc::new(mesh), [length, depth + 0.02, thick]);
    let Some(id) = fixed(b, label, geometry, pose, supports, 0.55, &[]) else { return };
    if let Some([x, y, w, d]) = hole {
        let mut shape = b.fresh(Family::Basin, [w, d, thick + 0.14], 0.0);
        shape.size = [w, d, (thick + 0.005) / 0.7];
        let local = Translation3::new(x, y, 0.002);
        let parent = if b.draw.chance(0.6) { id } else { last };
        fixed(
            b,
            "sink",
            Geometry::Shape(shape),
            pose * local,
            vec![Support { parent, contact: Contact::BuiltIn }],
            0.5,
            &[id, last],
        );
    }
    if length > 1.6 && b.draw.chance(0.45) {
        let x = hole.map_or(0.0, |h| if h[0] > 0.0 { -length * 0.3 } else { length * 0.3 });
        let shape = b.fresh(Family::Stove, [0.5, depth * 0.8, 0.03], 0.0);
        let local = Translation3::new(x, 0.0, thick + 0.001);
        fixed(
            b,
            "stove",
            Geometry::Shape(shape),
            pose * local,
            vec![Support { parent: id, contact: Contact::BuiltIn }],
            0.15,
            &[id],
        );
    }
}

/// A slab about its base centre; the hole is (x, y, width, depth).
fn slab_with_hole([w, d, h]: [f32; 3], hole: Option<[f32; 4]>) -> crate::mesh::Mesh {
    let mut m = crate::mesh::Mesh::default();
    let (x, y) = (w / 2.0, d / 2.0);
    match hole {
        None => m.cuboid([-x, -y, 0.0], [x, y, h]),
        Some([cx, cy, hw, hd]) => {
            let (l, r, n, f) = (cx - hw / 2.0, cx + hw / 2.0, cy - hd / 2.0, cy + hd / 2.0);
            m.cuboid([-x, -y, 0.0], [l, y, h]);
            m.cuboid([r, -y, 0.0], [x, y, h]);
            m.cuboid([l, -y, 0.0], [r, n, h]);
            m.cuboid([l, f, 0.0], [r, y, h]);
        }
    }
    m
}

/// A sink in a bathroom: on a pedestal at the wall, or in a cabinet.
fn wash_place(b: &mut Builder) {
    let Some(kind) = catalogue::find("sink") else { return };
    if b.draw.chance(0.45) {
        let (shape, model) = b.shape(kind, Some(Family::Pedestal));
        let id = b.place_at(kind, &shape, model, catalogue::Place::Back);
        let wall = b.wall_ids.iter().copied().find(|i| *i > 0);
        if let (Some(id), Some(parent)) = (id, wall)
            && let Some(i) = b.out.iter_mut().find(|i| i.id == id)
        {
            i.supports = vec![Support { parent, contact: Contact::SupportedBy }];
        }
        return;
    }
    let Some(host) = b.place("bath cabinet") else { return };
    let Some(h) = b.out.iter().find(|i| i.id == host) else { return };
    let ([w, d, top], pose) = (h.size(), h.room_from_object);
    if pose.translation.z > 0.1 {
        return;
    }
    let mut shape = b.fresh(Family::Basin, [0.5, 0.4, 0.22], 0.25);
    shape.size = [shape.size[0].min(w), shape.size[1].min(d), shape.size[2]];
    let supports = vec![Support { parent: host, contact: Contact::BuiltIn }];
    fixed(
        b,
        "sink",
        Geometry::Shape(shape),
        pose * Translation3::new(0.0, 0.0, top + 0.001),
        supports,
        0.85,
        &[host],
    );
}

/// Adds something at a given pose if it fits.
pub(crate) fn fixed(
    b: &mut Builder,
    label: &'static str,
    geometry: Geometry,
    pose: Isometry3<f32>,
    supports: Vec<Support>,
    albedo: f32,
    ignore: &[u32],
) -> Option<u32> {
    let size = match &geometry {
        Geometry::Shape(s) => s.size,
        Geometry::Built(_, s) => *s,
    };
    b.fits(&pose, size, ignore, -0.012)?;
    let id = b.add(label, geometry, pose, supports, albedo);
    b.occupy(id);
    Some(id)
}

/// Along the open side of a bathtub or shower.
fn shower_curtain(b: &mut Builder) {
    let Some(host) = b.out.iter().find(|i| matches!(i.label, "bathtub" | "shower")) else { return };
    let ([w, d, _], pose) = (host.size(), host.room_from_object);
    if !b.draw.chance(0.6) {
        return;
    }
    let mut shape = b.fresh(Family::Curtain, [w * 0.45, 0.12, 1.8], 0.25);
    shape.size[0] = shape.size[0].min(w);
    shape.size[2] = shape.size[2].min(b.plan.height - 0.3);
    let x = (w - shape.size[0]) * if b.draw.chance(0.5) { 0.5 } else { -0.5 };
    let z = b.plan.height - 0.15 - shape.size[2];
    let hang = Translation3::new(x, d / 2.0 + 0.08, z);
    let parent = b.wall_ids.iter().copied().find(|i| *i > 0).unwrap_or(FLOOR);
    let contact = if b.draw.chance(0.6) { Contact::SupportedBy } else { Contact::HangingOn };
    fixed(
        b,
        "shower curtain",
        Geometry::Shape(shape),
        pose * hang,
        vec![Support { parent, contact }],
        0.6,
        &[],
    );
}

/// What the recipe asks for, large things first, then clutter.
fn furnish(b: &mut Builder, recipe: &Recipe, richness: f32) {
    for &(label, p, mean) in recipe.items {
        if b.draw.chance((p * richness.powf(0.7)).min(0.98)) {
            let extra = if mean > 1.0 { b.draw.poisson((mean - 1.0) * richness) } else { 0 };
            for _ in 0..=extra {
                b.place(label);
            }
        }
    }
    for &(label, p, mean) in CLUTTER {
        if b.draw.chance((p * richness.powf(0.7)).min(0.98)) {
            let extra = b.draw.poisson((mean - 1.0).max(0.0) * richness);
            for _ in 0..=extra {
                b.place(label);
            }
        }
    }
}

//! Statistics of generated rooms beside those of real ones.

use crate::real;
use crate::relations::chain_depths;
use crate::room::{Room, Scan};
use crate::tree::{FEATURES, Tree};
use crate::world::World;
use rayon::prelude::*;
use scan3r::{Dataset as _, Error, LabelSet, Relation};
use std::collections::BTreeMap;
use std::fmt;

/// One figure: generated, real, and the range it has to lie in.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What is counted.
    pub name: String,
    /// In the generated rooms.
    pub generated: f64,
    /// In real rooms, where known.
    pub real: Option<f64>,
    /// Smallest and largest value that is accepted.
    pub bar: Option<[f64; 2]>,
}

impl Line {
    /// Whether the figure lies outside its bar.
    #[must_use]
    pub fn missed(&self) -> bool {
        self.bar.is_some_and(|[low, high]| !(low..=high).contains(&self.generated))
    }
}

/// All figures of a world; `Display` prints them as a table.
#[derive(Clone, Debug, Default)]
pub struct Stats {
    /// Single figures.
    pub lines: Vec<Line>,
    /// Shares: (table, name, generated, real), each from 0 to 1.
    pub shares: Vec<(&'static str, String, f64, f64)>,
    /// Instances per reference scan by raw label.
    pub labels: BTreeMap<&'static str, f64>,
}

impl Stats {
    /// The figures outside their bars.
    #[must_use]
    pub fn misses(&self) -> Vec<&Line> {
        self.lines.iter().filter(|l| l.missed()).collect()
    }

    fn line(&mut self, name: impl Into<String>, generated: f64, real: Option<f64>, bar: Option<[f64; 2]>) {
        self.lines.push(Line { name: name.into(), generated, real, bar });
    }

    /// Compares counts as shares, and adds their total variation distance with its bar.
    fn compare(&mut self, table: &'static str, generated: &BTreeMap<String, f64>, real: &[(String, f64)]) {
        let (g, r) = (generated.values().sum::<f64>().max(1.0), real.iter().map(|r| r.1).sum::<f64>());
        let mut distance = 0.0;
        for (name, n) in real {
            let (a, b) = (generated.get(name).copied().unwrap_or(0.0) / g, n / r);
            distance += (a - b).abs() / 2.0;
            self.shares.push((table, name.clone(), a, b));
        }
        let known = |k: &String| real.iter().any(|r| r.0 == *k);
        distance += generated.iter().filter(|(k, _)| !known(k)).map(|(_, n)| n / g / 2.0).sum::<f64>();
        self.line(format!("{table}: total variation distance"), distance, Some(0.0), Some([0.0, 0.10]));
    }
}

impl fmt::Display for Stats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<52} {:>10} {:>10}   bar", "", "generated", "real")?;
        for l in &self.lines {
            let real = l.real.map_or_else(|| "-".to_owned(), |r| format!("{r:.3}"));
            let bar = l.bar.map_or_else(String::new, |[a, b]| format!("{a:.3} to {b:.3}"));
            let verdict = if l.missed() { "  MISSED" } else { "" };
            writeln!(f, "{:<52} {:>10.3} {:>10}   {bar}{verdict}", l.name, l.generated, real)?;
        }
        let mut table = "";
        for (t, name, g, r) in &self.shares {
            if *t != table {
                writeln!(f, "\n{t} (percent)")?;
                table = t;
            }
            writeln!(f, "  {name:<26} {:>7.2} {:>7.2}", 100.0 * g, 100.0 * r)?;
        }
        writeln!(f, "\ninstances per reference scan, by raw label")?;
        for (label, n) in &self.labels {
            write!(f, "{label} {n:.3}; ")?;
        }
        writeln!(f)
    }
}

/// The nearest-rank percentile of values.
fn percentile(values: &[f64], p: f64) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    let rank = (p * v.len() as f64).ceil().max(1.0) as usize - 1;
    v.get(rank.min(v.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn around(centre: f64, share: f64) -> Option<[f64; 2]> {
    Some([centre * (1.0 - share), centre * (1.0 + share)])
}

/// Counts a world. Frames of the first `visits` reference scans are rendered.
///
/// # Errors
/// Those of the world's [`scan3r::Dataset`].
pub fn stats(world: &World, visits: usize) -> Result<Stats, Error> {
    let mut s = Stats::default();
    let rooms = world.generated();
    let scans: Vec<(&Room, &Scan)> = rooms.iter().flat_map(|r| r.scans.iter().map(move |s| (r, s))).collect();
    let relations: Vec<Vec<Relation>> =
        scans.par_iter().map(|(_, s)| world.relations(&s.id)).collect::<Result<_, _>>()?;
    instances(&mut s, rooms);
    labels_and_relations(&mut s, rooms, &scans, &relations);
    changes(&mut s, rooms);
    motions(&mut s, rooms);
    spreads(&mut s, rooms);
    frames(&mut s, world, visits)?;
    Ok(s)
}

fn annotated(scan: &Scan) -> f64 {
    scan.instances.iter().filter(|i| i.annotated).count() as f64
}

fn instances(s: &mut Stats, rooms: &[Room]) {
    let n: Vec<f64> = rooms.iter().map(|r| annotated(&r.scans[0])).collect();
    s.line("instances per reference scan: median", percentile(&n, 0.5), Some(25.0), Some([21.0, 29.0]));
    s.line("instances per reference scan: mean", mean(&n), Some(28.0), Some([24.0, 32.0]));
    s.line("instances per reference scan: p5", percentile(&n, 0.05), Some(9.0), None);
    s.line("instances per reference scan: p95", percentile(&n, 0.95), Some(57.0), None);
    let l20 = |r: &Room| {
        r.scans[0]
            .instances
            .iter()
            .filter(|i| i.annotated && LabelSet::L20.class_of(i.label).is_some())
            .count() as f64
    };
    s.line("of the l20 classes: mean", mean(&rooms.iter().map(l20).collect::<Vec<_>>()), Some(14.6), None);
    for i in rooms.iter().flat_map(|r| &r.scans[0].instances).filter(|i| i.annotated) {
        *s.labels.entry(i.label).or_default() += 1.0 / rooms.len() as f64;
    }
}

fn labels_and_relations(
    s: &mut Stats,
    rooms: &[Room],
    scans: &[(&Room, &Scan)],
    relations: &[Vec<Relation>],
) {
    let (mut labels, mut predicates, mut chains) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
    for ((_, scan), relations) in scans.iter().zip(relations) {
        let ids: Vec<u32> = scan.instances.iter().filter(|i| i.annotated).map(|i| i.id).collect();
        for i in scan.instances.iter().filter(|i| i.annotated) {
            *labels.entry(LabelSet::L20.class_of(i.label).unwrap_or("none").to_owned()).or_insert(0.0) += 1.0;
        }
        for r in relations {
            *predicates.entry(r.predicate.clone()).or_insert(0.0) += 1.0;
        }
        for d in chain_depths(&ids, relations) {
            *chains.entry(d.min(4).to_string()).or_insert(0.0) += 1.0;
        }
    }
    let named = |t: &[(&str, f64)]| t.iter().map(|(n, v)| ((*n).to_owned(), *v)).collect::<Vec<_>>();
    s.compare("l20 shares", &labels, &named(&real::L20));
    s.compare("predicate shares", &predicates, &named(&real::PREDICATES));
    let depths: Vec<(String, f64)> =
        real::CHAINS.iter().enumerate().map(|(k, v)| (k.to_string(), *v)).collect();
    s.compare("support-chain depths", &chains, &depths);
    let mut per_scan = Vec::new();
    let mut at = 0;
    for room in rooms {
        per_scan.push(relations[at].len() as f64);
        at += room.scans.len();
    }
    s.line("relations per reference scan: median", percentile(&per_scan, 0.5), Some(65.0), None);
    s.line("relations per reference scan: mean", mean(&per_scan), Some(77.2), None);
}

fn changes(s: &mut Stats, rooms: &[Room]) {
    let (mut moved, mut removed, mut nonrigid, mut fresh, mut absent) =
        (vec![], vec![], vec![], vec![], vec![]);
    let (mut seen, mut moves) = (BTreeMap::<&str, f64>::new(), BTreeMap::<&str, f64>::new());
    for room in rooms {
        let reference: BTreeMap<u32, &str> =
            room.scans[0].instances.iter().filter(|i| i.annotated).map(|i| (i.id, i.label)).collect();
        for (entry, scan) in room.entry.scans.iter().zip(&room.scans[1..]) {
            moved.push(entry.rigid.moves().len() as f64);
            removed.push(entry.removed.as_ref().map_or(0, Vec::len) as f64);
            nonrigid.push(entry.nonrigid.as_ref().map_or(0, Vec::len) as f64);
            let known = |id: &u32| reference.contains_key(id);
            fresh.push(scan.instances.iter().filter(|i| i.annotated && !known(&i.id)).count() as f64);
            let there = |id: u32| scan.instance(id).is_some_and(|i| i.annotated);
            absent.push(reference.keys().filter(|id| !there(**id)).count() as f64);
            for label in reference.values() {
                *seen.entry(label).or_default() += 1.0;
            }
            for m in entry.rigid.moves() {
                if let Some(label) = reference.get(&m.instance_reference) {
                    *moves.entry(label).or_default() += 1.0;
                }
            }
        }
    }
    s.line("rescans per room", moved.len() as f64 / rooms.len() as f64, Some(110.0 / 47.0), None);
    s.line("moved per rescan: mean", mean(&moved), Some(3.207), around(3.207, 0.25));
    s.line("moved per rescan: median", percentile(&moved, 0.5), Some(3.0), None);
    s.line("moved per rescan: p95", percentile(&moved, 0.95), Some(7.0), None);
    s.line("removed per rescan: mean", mean(&removed), Some(0.562), around(0.562, 0.25));
    s.line("removed per rescan: p95", percentile(&removed, 0.95), Some(3.0), None);
    s.line("nonrigid per rescan: mean", mean(&nonrigid), Some(0.636), around(0.636, 0.25));
    s.line("new ids per rescan: mean", mean(&fresh), Some(1.868), around(1.868, 0.35));
    s.line("reference ids absent from a rescan: mean", mean(&absent), Some(6.697), around(6.697, 0.25));
    s.line("reference ids absent from a rescan: median", percentile(&absent, 0.5), Some(3.0), None);
    for (label, rate) in real::MOVE_RATES {
        let n = seen.get(label).copied().unwrap_or(0.0);
        let got = moves.get(label).copied().unwrap_or(0.0) / n.max(1.0);
        // Three standard errors of a rate of that many objects, and a quarter of it.
        let slack = 0.25 * rate + 3.0 * (rate * (1.0 - rate) / n.max(1.0)).sqrt() + 0.02;
        s.line(format!("move rate: {label}"), got, Some(rate), Some([rate - slack, rate + slack]));
    }
}

fn motions(s: &mut Stats, rooms: &[Room]) {
    let (mut turns, mut shifts, mut yaws, mut away, mut tilts) = (vec![], vec![], vec![], vec![], vec![]);
    for room in rooms {
        for scan in &room.scans[1..] {
            let frame = room.scans[0].scan_from_room * scan.scan_from_room.inverse();
            yaws.push(frame.rotation.angle().to_degrees());
            away.push(frame.translation.vector.norm());
            tilts.push((frame * nalgebra::Vector3::z()).angle(&nalgebra::Vector3::z()).to_degrees());
            for i in &scan.instances {
                let Some(old) = room.scans[0].instance(i.id) else { continue };
                if old.room_from_object == i.room_from_object || i.label == "blinds" {
                    continue;
                }
                let turn = f64::from(
                    old.room_from_object.rotation.angle_to(&i.room_from_object.rotation).to_degrees(),
                );
                turns.push(turn);
                if turn < 5.0 {
                    let d = i.room_from_object.translation.vector - old.room_from_object.translation.vector;
                    shifts.push(f64::from(d.xy().norm()));
                }
            }
        }
    }
    s.line(
        "turn of moved objects, degrees: median",
        percentile(&turns, 0.5),
        Some(12.34),
        around(12.34, 0.3),
    );
    s.line("turn of moved objects, degrees: p75", percentile(&turns, 0.75), Some(50.1), around(50.1, 0.3));
    s.line("turn of moved objects, degrees: p95", percentile(&turns, 0.95), Some(159.2), None);
    s.line(
        "shift of those below 5 degrees, m: median",
        percentile(&shifts, 0.5),
        Some(0.079),
        around(0.079, 0.3),
    );
    s.line(
        "shift of those below 5 degrees, m: p75",
        percentile(&shifts, 0.75),
        Some(0.153),
        around(0.153, 0.3),
    );
    s.line("rescan to reference, degrees: median", percentile(&yaws, 0.5), Some(52.5), around(52.5, 0.3));
    s.line("rescan to reference, m: median", percentile(&away, 0.5), Some(1.02), around(1.02, 0.3));
    s.line("rescan tilt, degrees: median", percentile(&tilts, 0.5), Some(0.73), around(0.73, 0.3));
    let groups: usize = rooms.iter().map(|r| r.entry.ambiguity.len()).sum();
    let with = rooms.iter().filter(|r| !r.entry.ambiguity.is_empty()).count();
    s.line("share of rooms with an ambiguity group", with as f64 / rooms.len() as f64, Some(0.405), None);
    s.line("ambiguity groups per room", groups as f64 / rooms.len() as f64, Some(0.618), None);
}

/// Standard deviation of the logarithm of box extents, least of width, depth and height, per class.
fn spreads(s: &mut Stats, rooms: &[Room]) {
    for class in LabelSet::L20.classes() {
        let sizes: Vec<[f32; 3]> = rooms
            .iter()
            .flat_map(|r| &r.scans[0].instances)
            .filter(|i| LabelSet::L20.class_of(i.label) == Some(class))
            .map(|i| i.size())
            .collect();
        if sizes.len() < 12 || *class == "floor" {
            continue;
        }
        let deviation = |k: usize| {
            let logs: Vec<f64> = sizes.iter().map(|v| f64::from(v[k]).ln()).collect();
            let m = mean(&logs);
            mean(&logs.iter().map(|l| (l - m) * (l - m)).collect::<Vec<_>>()).sqrt()
        };
        let all = [deviation(0), deviation(1), deviation(2)];
        // Walls and doors are as high as rooms are; thin things are as thick as they are.
        let volume = (all[0] * all[0] + all[1] * all[1] + all[2] * all[2]).sqrt() / 3.0_f64.sqrt();
        s.line(format!("log-sd of extents: {class} (n {})", sizes.len()), volume, None, Some([0.2, 9.0]));
    }
}

fn frames(s: &mut Stats, world: &World, visits: usize) -> Result<(), Error> {
    let rooms = &world.generated()[..visits.min(world.generated().len())];
    let counted: Vec<[f64; 4]> = rooms
        .par_iter()
        .map(|room| {
            let scan = &room.scans[0];
            let (mut n, mut invalid, mut lost) = (0.0, 0.0, 0.0);
            let mut hits = BTreeMap::<u32, u32>::new();
            for (frame, ids) in world.labelled_frames(&scan.id, 0)? {
                n += 1.0;
                invalid +=
                    frame.depth.iter().filter(|d| **d == 0.0).count() as f64 / frame.depth.len() as f64;
                lost += f64::from(u8::from(frame.world_from_camera.is_none()));
                for (id, _) in ids.iter().zip(&frame.depth).filter(|(_, d)| **d > 0.0) {
                    *hits.entry(*id).or_default() += 1;
                }
            }
            let seen = scan.instances.iter().filter(|i| hits.get(&i.id).copied().unwrap_or(0) >= 100).count();
            Ok([n, invalid / n, lost / n, seen as f64 / scan.instances.len() as f64])
        })
        .collect::<Result<_, Error>>()?;
    let column = |k: usize| counted.iter().map(|c| c[k]).collect::<Vec<_>>();
    let n = column(0);
    let sd = mean(&n.iter().map(|v| (v - mean(&n)).powi(2)).collect::<Vec<_>>()).sqrt();
    s.line("frames per visit at 5 Hz: mean", mean(&n), Some(245.0), Some([185.0, 305.0]));
    s.line("frames per visit at 5 Hz: standard deviation", sd, None, None);
    s.line("share of pixels without depth: mean over visits", mean(&column(1)), None, Some([0.05, 0.25]));
    s.line("share of pixels without depth: p95 over visits", percentile(&column(1), 0.95), None, None);
    s.line("share of frames without pose", mean(&column(2)), None, None);
    s.line("share of instances seen (100 samples) in a visit", mean(&column(3)), None, None);
    Ok(())
}

/// How well box sizes alone give the class: a tree of depth 8, grown on `train`, asked about `test`.
#[derive(Clone, Debug)]
pub struct SizeTree {
    /// Share of right answers over the instances of the 20 classes.
    pub accuracy: f64,
    /// Mean over classes of the share of right answers.
    pub class_mean: f64,
    /// Share of right answers over the instances that are neither wall nor floor.
    pub furniture: f64,
    /// Accuracy and class mean with clutter as a 21st class.
    pub with_none: [f64; 2],
    /// Recall and number per class.
    pub per_class: Vec<(&'static str, f64, usize)>,
}

/// Grows and asks the tree. Features: larger and smaller horizontal extent, height, height of the
/// centre, of the axis-aligned box in the scan's frame.
#[must_use]
pub fn size_tree(train: &World, test: &World) -> SizeTree {
    let classes = LabelSet::L20.classes();
    let run = |with_none: bool| {
        let keep = |s: &([f32; FEATURES], usize)| with_none || s.1 < classes.len();
        let (train, test): (Vec<_>, Vec<_>) = (
            samples(train).into_iter().filter(keep).collect(),
            samples(test).into_iter().filter(keep).collect(),
        );
        let tree = Tree::grow(&train, classes.len() + 1, 8);
        let mut right = vec![[0_usize; 2]; classes.len() + 1];
        for (x, c) in &test {
            right[*c][0] += usize::from(tree.classify(x) == *c);
            right[*c][1] += 1;
        }
        let total = right.iter().map(|r| r[0]).sum::<usize>() as f64 / test.len().max(1) as f64;
        let recalls: Vec<f64> =
            right.iter().filter(|r| r[1] > 0).map(|r| r[0] as f64 / r[1] as f64).collect();
        (total, mean(&recalls), right)
    };
    let (accuracy, class_mean, right) = run(false);
    let (a, c, _) = run(true);
    let per_class =
        classes.iter().zip(&right).map(|(c, r)| (*c, r[0] as f64 / r[1].max(1) as f64, r[1])).collect();
    let (mut r, mut n) = (0, 0);
    for (class, [right, all]) in classes.iter().zip(&right) {
        if !matches!(*class, "wall" | "floor") {
            (r, n) = (r + right, n + all);
        }
    }
    let furniture = r as f64 / n.max(1) as f64;
    SizeTree { accuracy, furniture, class_mean, with_none: [a, c], per_class }
}

/// Size and height of every annotated instance of the reference scans, with its class.
fn samples(world: &World) -> Vec<([f32; FEATURES], usize)> {
    let classes = LabelSet::L20.classes();
    let one = |scan: &Scan, i: &crate::room::Instance| {
        let (lo, hi) = scan.mesh(i).bounds()?;
        let e = hi - lo;
        let class = LabelSet::L20.class_of(i.label).and_then(|c| classes.iter().position(|k| *k == c));
        let floor = scan.scan_from_room.translation.z as f32;
        Some((
            [e.x.max(e.y), e.x.min(e.y), e.z, f32::midpoint(lo.z, hi.z) - floor],
            class.unwrap_or(classes.len()),
        ))
    };
    world
        .generated()
        .iter()
        .flat_map(|r| r.scans[0].instances.iter().filter(|i| i.annotated).filter_map(|i| one(&r.scans[0], i)))
        .collect()
}

//! Relations from geometry and the support tree, never from labels.

use crate::rng::{Draw, key};
use crate::room::{Geometry, Instance};
use crate::shapes::Family;
use crate::space::Solid;
use nalgebra::Vector3;
use scan3r::Relation;

/// How one object rests on, hangs at or belongs to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the names are those of the predicates")]
pub enum Contact {
    SupportedBy,
    AttachedTo,
    StandingOn,
    LyingOn,
    HangingOn,
    ConnectedTo,
    LeaningAgainst,
    PartOf,
    BelongingTo,
    BuiltIn,
    StandingIn,
    LyingIn,
    HangingIn,
    Cover,
}

impl Contact {
    /// The name of the predicate.
    #[must_use]
    pub fn predicate(self) -> &'static str {
        match self {
            Self::SupportedBy => "supported by",
            Self::AttachedTo => "attached to",
            Self::StandingOn => "standing on",
            Self::LyingOn => "lying on",
            Self::HangingOn => "hanging on",
            Self::ConnectedTo => "connected to",
            Self::LeaningAgainst => "leaning against",
            Self::PartOf => "part of",
            Self::BelongingTo => "belonging to",
            Self::BuiltIn => "build in",
            Self::StandingIn => "standing in",
            Self::LyingIn => "lying in",
            Self::HangingIn => "hanging in",
            Self::Cover => "cover",
        }
    }

    /// Carried from below: what the support chains count.
    #[must_use]
    pub fn carries(self) -> bool {
        matches!(self, Self::SupportedBy | Self::StandingOn | Self::LyingOn)
    }
}

/// Pairs farther apart have no relation of place, metres.
const NEAR: f32 = 0.9;
/// Pairs closer than this may be `close by`, metres.
const CLOSE: f32 = 0.4;
/// Tops must differ by this for `higher than`, metres.
const HIGHER: f32 = 0.08;
/// Volumes must differ by this factor for `bigger than`.
const BIGGER: f32 = 1.35;

/// The relations of the annotated instances of one scan. `seed` decides what the annotators left
/// out: the same pair is left out in every scan of a room.
pub(crate) fn relations(instances: &[Instance], seed: u64) -> Vec<Relation> {
    let listed: Vec<&Instance> = instances.iter().filter(|i| i.annotated).collect();
    let mut out = Vec::new();
    for i in &listed {
        for s in &i.supports {
            if listed.iter().any(|p| p.id == s.parent)
                && kept(seed, i.id, s.parent, support_rate(i, s.contact))
            {
                out.push(relation(i.id, s.parent, s.contact.predicate()));
            }
        }
    }
    let solids: Vec<(&Instance, Solid)> = listed
        .iter()
        .filter(|i| !is_building(i))
        .map(|i| {
            let b = i.oriented_box();
            (*i, Solid::new(&b.pose, b.half))
        })
        .collect();
    for (k, a) in solids.iter().enumerate() {
        for b in &solids[k + 1..] {
            pair(a, b, seed, &mut out);
        }
    }
    out.sort();
    out.dedup();
    out
}

fn relation(subject: u32, object: u32, predicate: &str) -> Relation {
    Relation { subject, object, predicate: predicate.to_owned() }
}

/// Walls, floors, ceilings: too large to be left or right of anything.
fn is_building(i: &Instance) -> bool {
    let joined = i.supports.first().is_none_or(|s| s.contact == Contact::AttachedTo);
    matches!(i.geometry, Geometry::Built(..)) && joined
}

/// Share of the supports of a kind that annotators wrote down.
fn support_rate(i: &Instance, contact: Contact) -> f32 {
    let [w, d, h] = i.size();
    let large = (w * d * h).cbrt() > 0.4;
    match contact {
        Contact::StandingOn | Contact::LyingOn if large => 0.93,
        Contact::StandingOn => 0.72,
        Contact::LyingOn => 0.75,
        Contact::HangingOn => 0.62,
        Contact::AttachedTo if h > 1.8 => 0.96,
        Contact::AttachedTo => 0.75,
        _ => 0.8,
    }
}

fn kept(seed: u64, a: u32, b: u32, rate: f32) -> bool {
    let k = key(seed, "annotated", &[u64::from(a.min(b)), u64::from(a.max(b))]);
    Draw::new(k, "kept", &[]).chance(rate)
}

fn volume(i: &Instance) -> f32 {
    i.size().iter().map(|v| v.max(0.03)).product()
}

fn family(i: &Instance) -> Option<Family> {
    match &i.geometry {
        Geometry::Shape(s) => Some(s.family),
        Geometry::Built(..) => None,
    }
}

/// All relations of one pair that is not joined by a support.
fn pair(a: &(&Instance, Solid), b: &(&Instance, Solid), seed: u64, out: &mut Vec<Relation>) {
    let (i, j) = (a.0, b.0);
    let both =
        |out: &mut Vec<Relation>, p: &str| out.extend([relation(i.id, j.id, p), relation(j.id, i.id, p)]);
    let oriented = |out: &mut Vec<Relation>, i_first: bool, p: &str, q: &str| {
        let (p, q) = if i_first { (p, q) } else { (q, p) };
        out.extend([relation(i.id, j.id, p), relation(j.id, i.id, q)]);
    };
    let alike = family(i).is_some() && family(i) == family(j);
    if i.model == j.model && kept(seed, i.id ^ 0x4000, j.id ^ 0x4000, 0.58) {
        both(out, "same as");
    }
    let linked = i.supports.iter().any(|s| s.parent == j.id) || j.supports.iter().any(|s| s.parent == i.id);
    let offset: Vector3<f32> = b.1.centre() - a.1.centre();
    if linked || offset.norm() > NEAR + a.1.radius() + b.1.radius() {
        return;
    }
    let gap = a.1.distance(&b.1);
    if gap > NEAR {
        return;
    }
    if alike
        && i.model != j.model
        && i.symmetry > 0
        && i.symmetry == j.symmetry
        && kept(seed, i.id ^ 0x8000, j.id ^ 0x8000, 0.07)
    {
        both(out, "same symmetry as");
    }
    let closeness = 1.0 - gap / CLOSE;
    if closeness > 0.0 && kept(seed, i.id, j.id, 0.36 * (0.4 + 0.6 * closeness)) {
        both(out, "close by");
    }
    let [vi, vj] = [volume(i), volume(j)];
    let tops = [i, j].map(|k| k.room_from_object.translation.z + k.size()[2]);
    let similar = if vi.max(vj) < 8.0 * vi.min(vj) { 0.4 } else { 0.17 };
    if kept(seed, i.id ^ 0x1000, j.id ^ 0x1000, if alike { 0.72 } else { similar }) {
        let (dx, dy) = (offset.x.abs(), offset.y.abs());
        if dx > 0.45 * dy && dx > 0.1 {
            oriented(out, offset.x > 0.0, "left", "right");
        }
        if dy > 1.6 * dx && dy > 0.1 {
            oriented(out, offset.y > 0.0, "front", "behind");
        }
    }
    if alike && (tops[0] - tops[1]).abs() > HIGHER && kept(seed, i.id ^ 0x800, j.id ^ 0x800, 0.8) {
        oriented(out, tops[0] > tops[1], "higher than", "lower than");
    }
    if alike && vi.max(vj) > BIGGER * vi.min(vj) && kept(seed, i.id ^ 0x2000, j.id ^ 0x2000, 0.45) {
        oriented(out, vi > vj, "bigger than", "smaller than");
    }
}

/// The highest number of `carries` steps from an instance down to the floor, of those annotated.
pub(crate) fn chain_depths(ids: &[u32], relations: &[Relation]) -> Vec<usize> {
    let carried = ["standing on", "lying on", "supported by"];
    let parent = |id: u32| {
        relations
            .iter()
            .filter(|r| r.subject == id && carried.contains(&r.predicate.as_str()))
            .map(|r| r.object)
            .next()
    };
    ids.iter()
        .map(|&id| {
            let mut depth = 0;
            let mut at = id;
            while let Some(p) = parent(at) {
                depth += 1;
                at = p;
                if depth > 8 {
                    break;
                }
            }
            depth
        })
        .collect()
}

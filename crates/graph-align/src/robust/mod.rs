//! The default algorithm: votes for poses, verification of each, an honest margin, refusal.
//!
//! 1. *Search.* Objects that are no structure are paired; labelled pairs of the query are looked up
//!    in an [`Index`] of the reference by their distances, the rarest first. Each reference pair that
//!    fits fixes a pose (yaw and shift, or any rotation where gravity is unknown) and votes for it
//!    with one over the number of rivals. Peaks of the votes are candidates. A prior pose limits the
//!    votes to its surroundings.
//! 2. *Verification.* Each candidate is refined by one-to-one matching and least squares, and judged
//!    by a log-likelihood ratio over labels, sizes and places, less a penalty for every object that
//!    should have been met and was not.
//! 3. *Decision.* A candidate is accepted when its evidence exceeds the log of the number of
//!    distinguishable poses by `accept`, and it explains enough of what should be visible. If the best
//!    distinct alternative is acceptable and less than `margin` behind, the answer is `Ambiguous`.
//! 4. *Changes.* Under the pose, every node is the same, relabelled, moved, or new; reference nodes
//!    at places that the query looked at and that have no counterpart are removed.
//!
//! 5. *Second chance.* Where nothing was accepted, two graphs of rooms with known footprints are compared by the sides of
//!    their boxes instead of centres and sizes: what was seen in part agrees in the sides that both saw. A pose that was
//!    accepted is laid by them. One that can slide or turn and fits as well is refused.
//!
//! Sources: voting by labelled pairs and verification follow the survey of registration methods
//! (CLIPPER, ROMAN, TEASER++) only in spirit; the likelihood ratio is our own.

mod change;
mod evidence;
mod index;
pub(crate) mod merge;
pub(crate) mod parts;
mod plane;
mod sides;
mod tilt;
mod vote;

pub use index::Index;

use crate::{LabelId, Match, Node, Outcome, Query, Vocabulary, Why};
use evidence::{Hypothesis, Memo, Scene};
use index::Item;
use nalgebra::{Isometry3, Point3};

/// Parameters of the robust algorithm. Log-evidence is natural.
#[derive(Clone, Debug, PartialEq)]
pub struct RobustParams {
    /// Classes of structure (walls, floors, ceilings): the centroid of such a node depends on how
    /// much of it was seen, so they do not vote and are matched by overlap.
    pub structure: Vec<LabelId>,
    /// The class of what has no name. Such nodes, and those whose class is less probable than `named`,
    /// are landmarks: they align like others, and weigh little in the class of a named node that they
    /// are seen to be.
    pub unnamed: Option<LabelId>,
    /// Probability from which a node is named.
    pub named: f32,
    /// Weight of an unnamed view of a named object, and of the unnamed views before a named one.
    pub unnamed_weight: f32,
    /// Largest distance of the two objects of a pair, metres.
    pub pair_range: f32,
    /// Evidence beyond the log of the number of poses that acceptance takes.
    pub accept: f32,
    /// Fewest matched objects that are no structure.
    pub fewest: usize,
    /// Smallest share of the objects that should have been met.
    pub visible: f32,
    /// Evidence by which the best pose must exceed the best distinct alternative.
    pub margin: f32,
    /// Evidence lost for an object that should have been met.
    pub missing: f32,
    /// Candidates that are verified.
    pub peaks: usize,
    /// Radius of the surroundings of a prior in which objects are looked for, metres.
    pub prior_range: f32,
    /// Visits in a row that look at a node's place and do not see it before it is removed: of a node
    /// that was seen once, and of one that was seen more often.
    pub patience: [u32; 2],
    /// A score from which one sighting counts as several.
    pub sure: f32,
    /// By how much the box of the last view may be extended by what was known before, metres a side; never
    /// beyond the longer of the two.
    pub slack: f32,
    /// A node with at least this share of its box in that of another node of its class is a part of
    /// that one: of structure, of objects, and of objects whose classes differ but are each other's
    /// rivals. Above 1 nothing is joined. Folds join, `update` does not.
    pub part: [f32; 3],
    /// Pieces of structure of one class that were seen in one visit, lie in one plane and are at most so far
    /// apart, with no wall that ends between them, are one, metres. Below 0 none is joined.
    pub gap: f32,
    /// By how much a fitted pose must exceed a prior in evidence to replace it. It orders poses; the
    /// bar of acceptance is the same for all of them.
    pub prior_weight: f32,
    /// Table entries and node pairs that may be looked at.
    pub budget: u64,
}

impl Default for RobustParams {
    fn default() -> Self {
        Self {
            structure: Vec::new(),
            unnamed: None,
            named: 0.0,
            unnamed_weight: 0.3,
            pair_range: 5.0,
            accept: 3.0,
            fewest: 4,
            visible: 0.2,
            margin: 13.0,
            missing: 0.8,
            peaks: 16,
            prior_range: 1.5,
            part: [0.6, 0.5, 0.7],
            gap: 1.5,
            sure: 0.8,
            patience: [1, 2],
            slack: 0.35,
            prior_weight: 5.0,
            budget: 400_000,
        }
    }
}

impl RobustParams {
    fn is_named(&self, node: &Node) -> bool {
        Some(node.label) != self.unnamed && node.score + 0.5 / crate::graph::SCORE_STEPS >= self.named
    }

    /// Sets a number by its name, `patience` and `part` by `name.0` and `name.1`; false for a name that
    /// does not exist.
    pub fn set(&mut self, name: &str, value: f32) -> bool {
        match name {
            "named" => self.named = value,
            "unnamed_weight" => self.unnamed_weight = value,
            "pair_range" => self.pair_range = value,
            "accept" => self.accept = value,
            "fewest" => self.fewest = value as usize,
            "visible" => self.visible = value,
            "margin" => self.margin = value,
            "missing" => self.missing = value,
            "peaks" => self.peaks = value as usize,
            "prior_range" => self.prior_range = value,
            "patience.0" => self.patience[0] = value as u32,
            "patience.1" => self.patience[1] = value as u32,
            "slack" => self.slack = value,
            "part.0" => self.part[0] = value,
            "part.1" => self.part[1] = value,
            "part.2" => self.part[2] = value,
            "gap" => self.gap = value,
            "sure" => self.sure = value,
            "prior_weight" => self.prior_weight = value,
            "budget" => self.budget = value as u64,
            _ => return false,
        }
        true
    }

    /// The defaults, with `wall`, `floor` and `ceiling` of a vocabulary as structure and `none` as what
    /// has no name.
    #[must_use]
    pub fn for_vocabulary(vocabulary: &Vocabulary) -> Self {
        let structure =
            ["wall", "floor", "ceiling"].iter().filter_map(|n| vocabulary.find_label(n)).collect();
        Self { structure, unnamed: vocabulary.find_label("none"), ..Self::default() }
    }
}

/// Work done so far, against the budget.
pub(crate) struct Work {
    budget: u64,
    left: u64,
    exhausted: bool,
}

impl Work {
    fn new(budget: u64) -> Self {
        Self { budget, left: budget, exhausted: false }
    }

    /// A share of what is left.
    fn part(&self, of: u64) -> Self {
        Self::new(self.left / of)
    }

    /// What a part has spent is spent here too.
    fn take(&mut self, part: &Self) {
        self.left -= part.spent();
        self.exhausted |= part.exhausted;
    }

    fn spent(&self) -> u64 {
        self.budget - self.left
    }

    /// Takes `n` units; false if they are not there.
    fn spend(&mut self, n: u64) -> bool {
        if n > self.left {
            self.exhausted = true;
            return false;
        }
        self.left -= n;
        true
    }
}

/// Two poses are distinct beyond this at the query's centre, metres and radians.
const DISTINCT: (f32, f32) = (0.5, 0.1745);
/// Log of the number of poses is at least this: rooms look alike beyond chance, even near a prior.
const FEWEST_POSES: f32 = 10.0;
/// Share of the query's objects above which the mirror image is looked for at the place that was found alone, and
/// above which it is not looked for: of 24,000 mirrored rooms none was explained by more than 6 objects of 7.
const EXPLAINED: [f32; 2] = [0.6, 0.9];

/// What a pose by sides takes beyond the bar, since its pairs were chosen among many: in all, and of pairs without
/// structure; its margin, over other places and over itself when it slides or turns a little; the share of the objects that
/// should have been met; and the noise of centres, metres.
struct BySides {
    all: f32,
    objects: f32,
    margin: f32,
    visible: f32,
    noise: f32,
}

const BY_SIDES: BySides = BySides { all: 26.0, objects: 12.0, margin: 8.0, visible: 0.5, noise: 0.12 };

/// The query's objects, in an order of content.
fn objects(query: &Query<'_>, params: &RobustParams) -> Vec<Item> {
    let objects = query.graph.nodes().filter(|n| !params.structure.contains(&n.label));
    let mut items: Vec<Item> = objects.map(|n| Item::of(&n)).collect();
    items.sort_by(Item::order);
    items
}

pub(crate) fn align(index: &Index, query: &Query<'_>, params: &RobustParams) -> Outcome {
    align_counted(index, query, params).0
}

/// The same without the second chance, for a query that may lie in many places: what is rarely wrong of two rooms
/// is wrong too often of fifteen.
pub(crate) fn align_first(index: &Index, query: &Query<'_>, params: &RobustParams) -> Outcome {
    attempt(index, query, params, false).0
}

/// The robust algorithm on an index of the reference, and the work that it took: table entries and
/// node pairs looked at, at most [`RobustParams::budget`].
#[must_use]
pub fn align_counted(index: &Index, query: &Query<'_>, params: &RobustParams) -> (Outcome, u64) {
    attempt(index, query, params, true)
}

fn attempt(index: &Index, query: &Query<'_>, params: &RobustParams, sides: bool) -> (Outcome, u64) {
    let items = objects(query, params);
    if items.len() < params.fewest {
        return (Outcome::NoMatch { why: Why::SmallQuery }, 0);
    }
    let memo = Memo::new(items.len());
    let scene = Scene::new(index, &items, query, params, &memo);
    // A quarter stays for the mirror image, the last fits, and what the search by sides has found.
    let mut work = Work::new(params.budget - params.budget / 4);
    let found = search(&scene, query.prior.as_ref(), &mut work);
    let mut spare = Work::new(params.budget / 4);
    let sides = sides && query.prior.is_none();
    let outcome = decide(query, &scene, found, sides, &mut work, &mut spare);
    let outcome = match outcome {
        Outcome::NoMatch { why: Why::NoSupport } if sides && scene.upright => {
            by_sides(query, &scene, &mut work, &mut spare)
        }
        other => other,
    };
    (outcome, work.spent() + spare.spent())
}

/// The second chance of a query whose objects were seen in part: see [`sides`].
fn by_sides(query: &Query<'_>, scene: &Scene<'_>, work: &mut Work, spare: &mut Work) -> Outcome {
    let refused = |why| Outcome::NoMatch { why };
    let Some(views) = sides::Views::of(scene.index, query.graph, scene.params) else {
        return refused(Why::NoSupport);
    };
    let found = views.poses(work);
    let Some(best) = found.first() else { return refused(Why::NoSupport) };
    let centre = vote::centre(scene.query);
    let distinct =
        |p: &&sides::Pose| !same_pose(&p.reference_from_query, &best.reference_from_query, &centre);
    let margin = best.evidence - found.iter().find(distinct).map_or(0.0, |p| p.evidence);
    let bar = ln_poses(scene, query) + scene.params.accept;
    let (met, by_objects) = best.objects;
    let sure = best.evidence > bar + BY_SIDES.all && by_objects > bar + BY_SIDES.objects;
    let seen = met >= scene.params.fewest && met as f32 >= BY_SIDES.visible * best.common as f32;
    if !(sure && seen && margin > BY_SIDES.margin && best.level) {
        return refused(Why::NoSupport);
    }
    if views.mirrored(work).first().is_some_and(|m| *m >= best.evidence) {
        return refused(Why::Mirrored);
    }
    if let Some(why) = why_loose(&views, &best.reference_from_query, spare) {
        return refused(why);
    }
    let h = Hypothesis {
        pose: best.reference_from_query,
        pairs: Vec::new(),
        evidence: best.evidence,
        preference: 0.0,
        sigma: BY_SIDES.noise,
        query_missing: 0,
        reference_missing: 0,
    };
    Outcome::Match(change::describe(query, scene, &h, Some(margin)))
}

/// What became of every node if the query lies at `pose` as a matter of fact; nothing is searched or
/// verified.
pub(crate) fn associate(
    index: &Index,
    query: &Query<'_>,
    pose: &Isometry3<f32>,
    params: &RobustParams,
) -> Match {
    let items = objects(query, params);
    let memo = Memo::new(items.len());
    let scene = Scene::new(index, &items, query, params, &memo);
    // No budget: the work is bounded by the objects near each other.
    let h = scene.judge_at(pose, &mut Work::new(u64::MAX));
    change::describe(query, &scene, &h, None)
}

/// Distinct refined candidates, best first.
fn search<'a>(scene: &Scene<'a>, prior: Option<&Isometry3<f32>>, work: &mut Work) -> Vec<Hypothesis<'a>> {
    let (index, items, params) = (scene.index, scene.query, scene.params);
    // Half for the search, half for the verification, so that the one cannot starve the other.
    let mut searching = work.part(2);
    let mut candidates = match (prior, scene.upright) {
        (Some(prior), true) => {
            let near = vote::Near { prior, range: params.prior_range };
            vote::poses(index, items, Some(&near), params, &mut searching)
        }
        (None, true) => vote::poses(index, items, None, params, &mut searching),
        (_, false) => tilt::poses(index, items, params, &mut searching),
    };
    candidates.extend(prior);
    work.take(&searching);
    let mut verifying = work.part(1);
    let mut found: Vec<Hypothesis<'_>> =
        candidates.iter().filter_map(|c| scene.refine(c, &mut verifying)).collect();
    if let Some(prior) = prior {
        // A few noisy objects do not overrule what is known of the frames.
        let h = scene.judge_at(prior, &mut verifying);
        found.push(Hypothesis { preference: params.prior_weight, ..h });
    }
    found.sort_by(|a, b| b.rank().total_cmp(&a.rank()));
    let centre = vote::centre(items);
    let mut distinct: Vec<Hypothesis<'_>> = Vec::new();
    for h in found {
        if !distinct.iter().any(|d| same_pose(&d.pose, &h.pose, &centre)) {
            distinct.push(h);
        }
    }
    work.take(&verifying);
    distinct
}

/// Whether the query's mirror image is explained better than the query itself. Distances and labels
/// of a mirrored room agree, and parts of it that are symmetric fit. Where little of the query is
/// explained, or gravity is unknown, the image is searched for everywhere, else at the place that was found
/// alone: a room in which most of a mirrored one fits by chance is that room itself.
fn mirror_fits_better(scene: &Scene<'_>, best: &Hypothesis<'_>, work: &mut Work) -> bool {
    let explained = EXPLAINED.map(|share| best.pairs.len() as f32 >= share * scene.query.len() as f32);
    if explained[1] && scene.upright {
        return false;
    }
    let mut items: Vec<Item> = scene.query.to_vec();
    items.iter_mut().for_each(|i| i.p.x = -i.p.x);
    items.sort_by(Item::order);
    let memo = Memo::new(items.len());
    let image = Scene { query: &items, mirrored: !scene.mirrored, memo: &memo, ..*scene };
    let bar = best.evidence + scene.params.margin;
    if !explained[0] || !scene.upright {
        return search(&image, None, work).first().is_some_and(|m| m.evidence > bar);
    }
    let mut place = scene.around(&best.pose);
    place.sort_by(|a, b| a.1.order(&b.1));
    // What each object of the image could be worth there at most; a sum below the bar ends the question.
    let most = image.most(&place);
    if !work.spend((items.len() * place.len()) as u64) || most.iter().sum::<f32>() <= bar {
        return false;
    }
    let poses = vote::poses_among(scene.index, &items, &place, work);
    poses.iter().filter_map(|p| image.refine_beyond(p, &most, bar, work)).any(|m| m.evidence > bar)
}

fn same_pose(a: &Isometry3<f32>, b: &Isometry3<f32>, at: &Point3<f32>) -> bool {
    (a * at - b * at).norm() < DISTINCT.0 && a.rotation.angle_to(&b.rotation) < DISTINCT.1
}

fn decide(
    query: &Query<'_>,
    scene: &Scene<'_>,
    distinct: Vec<Hypothesis<'_>>,
    sides: bool,
    work: &mut Work,
    spare: &mut Work,
) -> Outcome {
    let params = scene.params;
    let bar = ln_poses(scene, query) + params.accept;
    let mut good: Vec<Hypothesis<'_>> = distinct.into_iter().filter(|h| acceptable(h, bar, params)).collect();
    let Some(best) = good.first() else {
        return Outcome::NoMatch { why: if work.exhausted { Why::Budget } else { Why::NoSupport } };
    };
    if mirror_fits_better(scene, best, spare) {
        return Outcome::NoMatch { why: Why::Mirrored };
    }
    let rivals = good.iter().filter(|h| best.rank() - h.rank() < params.margin).count();
    let margin = good.get(1).map(|h| best.rank() - h.rank());
    // A pose that was known before stays as it is.
    for h in good[..rivals].iter_mut().filter(|h| h.preference == 0.0) {
        if let Some(settled) = scene.settled(h, spare) {
            *h = settled;
        }
    }
    let answer = |h: &Hypothesis<'_>, margin: Option<f32>| change::describe(query, scene, h, margin);
    if rivals > 1 {
        return Outcome::Ambiguous { candidates: good[..rivals].iter().map(|h| answer(h, None)).collect() };
    }
    if sides {
        match laid_by_sides(query, scene, &good[0].pose, work) {
            Laid::Unknown => {}
            Laid::Here(pose) => good[0].pose = pose,
            Laid::Refused(why) => return Outcome::NoMatch { why },
        }
    }
    Outcome::Match(answer(&good[0], margin))
}

/// What sides say of a pose that was found by the middles of objects.
enum Laid {
    /// Nothing: footprints are not known, or too few agree.
    Unknown,
    /// They agree on this place nearby.
    Here(Isometry3<f32>),
    /// They agree as well somewhat further on, or it could not be found out.
    Refused(Why),
}

/// A pose that was found by the middles of objects, laid by their sides: what was seen in part has its middle elsewhere.
fn laid_by_sides(query: &Query<'_>, scene: &Scene<'_>, pose: &Isometry3<f32>, work: &mut Work) -> Laid {
    let Some(views) = sides::Views::of(scene.index, query.graph, scene.params) else { return Laid::Unknown };
    let centre = vote::centre(scene.query);
    let near = |l: &sides::Pose| {
        l.objects.0 >= scene.params.fewest && same_pose(&l.reference_from_query, pose, &centre)
    };
    let Some(laid) = views.laid(pose, work).filter(near) else { return Laid::Unknown };
    why_loose(&views, &laid.reference_from_query, work)
        .map_or(Laid::Here(laid.reference_from_query), Laid::Refused)
}

/// Why a pose does not hold, if so.
fn why_loose(views: &sides::Views<'_>, pose: &Isometry3<f32>, work: &mut Work) -> Option<Why> {
    match views.hold(pose, work) {
        Some(held) => (held < BY_SIDES.margin).then_some(Why::Loose),
        None => Some(Why::Budget),
    }
}

fn acceptable(h: &Hypothesis<'_>, bar: f32, params: &RobustParams) -> bool {
    let met = h.pairs.len();
    let should = met + h.query_missing.min(h.reference_missing);
    met >= params.fewest && met as f32 >= params.visible * should as f32 && h.evidence > bar
}

/// Natural log of the number of poses that can be told apart: places of 0.2 m where the reference
/// has objects (or within the prior's reach) times 36 yaws, times 100 tilts where gravity is unknown.
fn ln_poses(scene: &Scene<'_>, query: &Query<'_>) -> f32 {
    let area = scene.index.len() as f32 / scene.index.density();
    let area = if query.prior.is_some() { area.min(scene.params.prior_range.powi(2)) } else { area };
    let tilts: f32 = if scene.upright { 1.0 } else { 100.0 };
    (area / 0.04 * 36.0 * tilts).ln().max(FEWEST_POSES)
}

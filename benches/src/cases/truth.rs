//! The right answer to a case, as its scorer reads it.

use super::draft::Draft;
use super::view::{Seen, cell_of};
use super::{Frames, row_major};
use crate::building::Object;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

pub(super) fn truth(
    d: &Draft,
    query: &[Seen],
    reference: &[Seen],
    cells: &BTreeSet<[i32; 3]>,
    frames: &Frames,
) -> Value {
    let back = frames.reference_from_query().inverse();
    // (seen, clearly so or clearly not)
    let looked = |r: &Seen| {
        let c = cell_of(&(back * r.centroid));
        let own = cells.contains(&c);
        let even = (0..3).all(|k| {
            [-1, 1].iter().all(|s| {
                let mut n = c;
                n[k] += s;
                cells.contains(&n) == own
            })
        });
        (own, even)
    };
    let mut by_object: BTreeMap<usize, Vec<&Seen>> = BTreeMap::new();
    query.iter().for_each(|q| by_object.entry(q.object).or_default().push(q));
    let (mut matches, mut moved, mut optional, mut loose) = (vec![], vec![], vec![], vec![]);
    let (mut removed, mut unseen, mut borderline) = (vec![], vec![], vec![]);
    let (mut relabelled, mut same_object) = (vec![], vec![]);
    let nothing = d.outcome == "no_match";
    for r in reference {
        let mut counterparts = by_object.get(&r.object).map_or(&[][..], Vec::as_slice);
        if nothing {
            same_object.extend(counterparts.iter().map(|q| json!([q.id, r.id])));
            counterparts = &[];
        }
        let place = |list: &[Option<Object>]| list[r.object].as_ref().map(|o| o.pose.translation.vector);
        let shift = match (place(&d.before), place(&d.after)) {
            (Some(a), Some(b)) => (a - b).norm(),
            _ => 0.0,
        };
        let (own, even) = looked(r);
        for q in counterparts {
            let pair = json!([q.id, r.id]);
            if d.relabelled.contains(&r.object) {
                relabelled.push(pair.clone());
            }
            if shift < 0.1 {
                matches.push(pair.clone());
                if q.loose {
                    loose.push(pair);
                }
            } else if shift < 0.3 || !(own && even) {
                optional.push(pair);
            } else {
                moved.push(pair);
            }
        }
        if counterparts.is_empty() {
            let structure = d.before[r.object].as_ref().is_some_and(Object::is_structure);
            if nothing {
                unseen.push(r.id);
            } else if structure || !even {
                borderline.push(r.id);
            } else if own {
                removed.push(r.id);
            } else {
                unseen.push(r.id);
            }
        }
    }
    let known: BTreeSet<usize> = reference.iter().map(|r| r.object).collect();
    let added: Vec<u64> =
        query.iter().filter(|q| nothing || !known.contains(&q.object)).map(|q| q.id).collect();
    let alternatives: Vec<Value> = d
        .alternatives
        .iter()
        .map(|a| {
            let t = frames.reference_from_domain * a * frames.query_from_domain.inverse();
            json!({"T_ref_query": row_major(&t), "matches": []})
        })
        .collect();
    json!({
        "outcome": d.outcome,
        "T_ref_query": if nothing { Value::Null } else { json!(row_major(&frames.reference_from_query())) },
        "matches": matches, "moved": moved, "moved_optional": optional, "removed": removed,
        "unseen": unseen, "borderline": borderline, "added": added, "relabelled": relabelled, "loose": loose,
        "alternatives": alternatives, "same_object_pairs": same_object,
    })
}

//! 3DSSG's `objects.json` and `relationships*.json`, split and unsplit.

use crate::labels::RELATIONSHIP_IDS;
use crate::{Error, Relation};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A relationships file. Key = (scan, split); a scan without `split` is complete.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RelationshipsFile {
    /// Graphs or parts of graphs.
    pub scans: Vec<ScanRelationships>,
}

/// The relations of a scan, or of one sub-graph of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScanRelationships {
    /// Scan id.
    pub scan: String,
    /// Number of the sub-graph, where the file is split.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub split: Option<u32>,
    /// Raw label per instance; keys are ids as text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objects: Option<BTreeMap<String, String>>,
    /// `[subject, object, predicate id, predicate name]`.
    pub relationships: Vec<(u32, u32, u32, String)>,
}

impl RelationshipsFile {
    /// All relations of a scan, the sub-graphs united, each once, sorted.
    #[must_use]
    pub fn of_scan(&self, scan: &str) -> Vec<Relation> {
        let set: BTreeSet<Relation> = self
            .scans
            .iter()
            .filter(|s| s.scan == scan)
            .flat_map(|s| &s.relationships)
            .map(|(subject, object, _, name)| Relation {
                subject: *subject,
                object: *object,
                predicate: name.clone(),
            })
            .collect();
        set.into_iter().collect()
    }

    /// An unsplit file.
    ///
    /// # Errors
    /// A predicate that is not one of the 26.
    pub fn from_relations(scans: &BTreeMap<String, Vec<Relation>>, path: &Path) -> Result<Self, Error> {
        let one = |(scan, relations): (&String, &Vec<Relation>)| {
            let relationships = relations.iter().map(|r| {
                let id = RELATIONSHIP_IDS.iter().position(|n| *n == r.predicate);
                let id = id.ok_or_else(|| Error::format(path, "predicate", format!("{:?}", r.predicate)))?;
                Ok((r.subject, r.object, id as u32, r.predicate.clone()))
            });
            Ok(ScanRelationships {
                scan: scan.clone(),
                split: None,
                objects: None,
                relationships: relationships.collect::<Result<_, Error>>()?,
            })
        };
        Ok(Self { scans: scans.iter().map(one).collect::<Result<_, Error>>()? })
    }
}

/// `objects.json`: the nodes of the graphs. Ids are text.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObjectsFile {
    /// One entry per scan.
    pub scans: Vec<ScanObjects>,
}

/// The nodes of one scan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScanObjects {
    /// Scan id.
    pub scan: String,
    /// Instances.
    pub objects: Vec<ObjectRecord>,
}

/// One node; fields that we do not use are kept as they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectRecord {
    /// Instance id as text.
    pub id: String,
    /// Raw label.
    pub label: String,
    /// Everything else.
    #[serde(flatten)]
    pub other: BTreeMap<String, serde_json::Value>,
}

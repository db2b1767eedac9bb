//! A room and what is in it: the values that the generator makes and everything else reads.

use crate::mesh::Mesh;
use crate::relations::Contact;
use crate::shapes::{Shape, Surface};
use nalgebra::{Isometry3, Point3};
use scan3r::RoomEntry;
use std::sync::Arc;

/// What an instance looks like.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry {
    /// Furniture and other parametric shapes.
    Shape(Shape),
    /// Parts of the building: a mesh about the centre of its base, and its full size.
    Built(Arc<Mesh>, [f32; 3]),
}

/// What an instance rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Support {
    /// Id of the instance that carries it.
    pub parent: u32,
    /// How.
    pub contact: Contact,
}

/// One physical object in one scan.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Id, constant over the scans of a room.
    pub id: u32,
    /// Raw 3RScan label.
    pub label: &'static str,
    /// Its surface.
    pub geometry: Geometry,
    /// Centre of the base to the room's layout frame (metres, z up, floor at 0).
    pub room_from_object: Isometry3<f32>,
    /// What carries it; the first is the one that the support tree follows.
    pub supports: Vec<Support>,
    /// Instances of one room with the same number are copies of one model.
    pub model: u64,
    /// Share of the sensor's light that comes back, 0 to 1.
    pub albedo: f32,
    /// False where the annotators left it out although it is there.
    pub annotated: bool,
    /// Rotational symmetry about the upright axis as in `3RScan.json`: 0 none to 3 round.
    pub symmetry: u8,
}

/// An oriented box: `half` extents about `pose`, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedBox {
    /// Box frame (origin in the centre) to the frame it was asked for in.
    pub pose: Isometry3<f32>,
    /// Half extents.
    pub half: [f32; 3],
}

impl OrientedBox {
    /// Smallest and largest corner of the axis-aligned box around it.
    #[must_use]
    pub fn bounds(&self) -> (Point3<f32>, Point3<f32>) {
        let r =
            self.pose.rotation.to_rotation_matrix().into_inner().abs() * nalgebra::Vector3::from(self.half);
        let c = Point3::from(self.pose.translation.vector);
        (c - r, c + r)
    }
}

impl Instance {
    /// Full width, depth and height, metres.
    #[must_use]
    pub fn size(&self) -> [f32; 3] {
        match &self.geometry {
            Geometry::Shape(s) => s.size,
            Geometry::Built(_, size) => *size,
        }
    }

    /// The mesh in the object's own frame.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        match &self.geometry {
            Geometry::Shape(s) => s.mesh(),
            Geometry::Built(m, _) => Mesh::clone(m),
        }
    }

    /// The box in the room's layout frame.
    #[must_use]
    pub fn oriented_box(&self) -> OrientedBox {
        let [w, d, h] = self.size();
        let centre = self.room_from_object * nalgebra::Translation3::new(0.0, 0.0, h / 2.0);
        OrientedBox { pose: centre, half: [w / 2.0, d / 2.0, h / 2.0] }
    }

    /// Places for other things, in the object's own frame.
    pub(crate) fn surfaces(&self) -> Vec<Surface> {
        match &self.geometry {
            Geometry::Shape(s) => s.surfaces(),
            Geometry::Built(_, [w, d, h]) => {
                vec![Surface { z: *h, centre: [0.0, 0.0], size: [*w, *d], clearance: 1.0, inside: false }]
            }
        }
    }

    /// The id of the instance whose motion it follows.
    #[must_use]
    pub fn parent(&self) -> Option<u32> {
        self.supports.first().map(|s| s.parent)
    }
}

/// One scan of a room: everything that is physically there at that time.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Uuid-shaped id.
    pub id: String,
    /// The room's layout frame to the scan's own frame, metres.
    pub scan_from_room: Isometry3<f64>,
    /// Everything that is there, by ascending id.
    pub instances: Vec<Instance>,
}

impl Scan {
    /// The instance of that id, if it is there.
    #[must_use]
    pub fn instance(&self, id: u32) -> Option<&Instance> {
        self.instances.binary_search_by_key(&id, |i| i.id).ok().map(|k| &self.instances[k])
    }

    /// Own frame of an object to the scan's own frame.
    #[must_use]
    pub fn scan_from_object(&self, instance: &Instance) -> Isometry3<f32> {
        (self.scan_from_room * instance.room_from_object.cast::<f64>()).cast()
    }

    /// The box of an instance in the scan's own frame.
    #[must_use]
    pub fn oriented_box(&self, instance: &Instance) -> OrientedBox {
        let b = instance.oriented_box();
        OrientedBox { pose: (self.scan_from_room * b.pose.cast::<f64>()).cast(), half: b.half }
    }

    /// The triangles of an instance in the scan's own frame.
    #[must_use]
    pub fn mesh(&self, instance: &Instance) -> Mesh {
        instance.mesh().transformed(&self.scan_from_object(instance))
    }
}

/// One generated room.
#[derive(Clone, Debug)]
pub struct Room {
    /// What kind of room it is, e.g. `kitchen`.
    pub kind: &'static str,
    /// Ids, transforms and changes in the form of `3RScan.json`.
    pub entry: RoomEntry,
    /// The reference scan, then the rescans in the order of `entry.scans`.
    pub scans: Vec<Scan>,
    /// Seed of what is random about its visits.
    pub(crate) seed: u64,
    /// The floor as rectangles (x0, y0, x1, y1) in the layout frame.
    pub(crate) floor: Vec<[f32; 4]>,
}

//! The questions that are asked of space: do two boxes overlap, how far are they apart, what does
//! a ray hit. Answered by parry, whose types stay in here.

use crate::mesh::Mesh;
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d::math::{Pose, Rotation, Vector};
use parry3d::query::{Ray, RayCast as _, distance, intersection_test};
use parry3d::shape::{Cuboid, TriMesh};

fn vector(v: &Vector3<f32>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// An oriented box.
#[derive(Clone, Debug)]
pub(crate) struct Solid {
    pose: Pose,
    shape: Cuboid,
    radius: f32,
}

impl Solid {
    pub(crate) fn new(pose: &Isometry3<f32>, half: [f32; 3]) -> Self {
        let q = pose.rotation.coords;
        let rotation = Rotation::from_xyzw(q.x, q.y, q.z, q.w);
        let half = Vector::new(half[0].max(1e-4), half[1].max(1e-4), half[2].max(1e-4));
        Self {
            pose: Pose::from_parts(vector(&pose.translation.vector), rotation),
            shape: Cuboid::new(half),
            radius: half.length(),
        }
    }

    pub(crate) fn centre(&self) -> Vector3<f32> {
        let t = self.pose.translation;
        Vector3::new(t.x, t.y, t.z)
    }

    /// Distance from the centre to a corner.
    pub(crate) fn radius(&self) -> f32 {
        self.radius
    }

    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let reach = self.radius + other.radius;
        (self.centre() - other.centre()).norm_squared() < reach * reach
            && intersection_test(&self.pose, &self.shape, &other.pose, &other.shape)
                .is_ok_and(|i| i.intersecting)
    }

    /// Shortest distance, 0 where the boxes overlap.
    pub(crate) fn distance(&self, other: &Self) -> f32 {
        distance(&self.pose, &self.shape, &other.pose, &other.shape).map_or(f32::INFINITY, |d| d.distance)
    }
}

/// Triangles that rays can be cast against.
pub(crate) struct Obstacles(Option<TriMesh>);

impl Obstacles {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let points = mesh.points.iter().map(|p| vector(&p.coords)).collect();
        Self(TriMesh::new(points, mesh.triangles.clone()).ok())
    }

    /// Distance along a ray of unit direction to the first hit within `reach`, metres.
    pub(crate) fn cast(&self, from: &Point3<f32>, along: &Vector3<f32>, reach: f32) -> Option<f32> {
        self.0.as_ref()?.cast_local_ray(&Ray::new(vector(&from.coords), vector(along)), reach, false)
    }
}

//! Pinhole cameras. Camera frame: x forward, y left, z up. View frame, in which images are rendered: x right,
//! y down, z forward. Both are in m.

use ipc_types::{EXTERNAL_SIDE, HAND_SIDE};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::math::affine::{Affine3, Vec3, scaled};
use crate::math::trig::sin_cos;
use scene::{self, CameraMount, CameraSlot, Link, Snapshot};

/// A pinhole camera with a square image.
#[derive(Clone, PartialEq)]
pub(crate) struct PinholeCamera {
    /// Side of the image, in pixels.
    pub(crate) side: usize,
    /// Focal length, in pixels.
    pub(crate) focal_px: f32,
    /// Depths of the near and far clipping planes, in m.
    pub(crate) clip_m: [f32; 2],
    /// x/z and y/z at the centre of the image. Nonzero for a tile of a larger image, whose projection is
    /// off-axis.
    pub(crate) image_centre: [f32; 2],
    mount: Mount,
}

#[derive(Clone, PartialEq)]
enum Mount {
    /// Pose in the world.
    World(Isometry3<f32>),
    /// Pose in the hand frame of an arm.
    Hand { arm: usize, pose: Isometry3<f32> },
}

impl PinholeCamera {
    /// Creates the camera of a sampled scene, including its pose error.
    pub(crate) fn new(camera: &scene::Camera) -> Self {
        let side = match camera.slot {
            CameraSlot::External1 | CameraSlot::External2 => EXTERNAL_SIDE,
            CameraSlot::Hand1 | CameraSlot::Hand2 => HAND_SIDE,
        };
        let (sin, cos) = sin_cos(camera.fov_y_rad / 2.0);
        Self {
            side,
            focal_px: (side as f64 / 2.0 * cos / sin) as f32,
            clip_m: camera.clip_m.map(|c| c as f32),
            image_centre: [0.0; 2],
            mount: match &camera.mount {
                CameraMount::World { eye, target } => {
                    Mount::World((look_at(*eye, *target) * camera.pose_error).cast())
                }
                CameraMount::Hand { arm, pose } => {
                    Mount::Hand { arm: *arm, pose: (pose * camera.pose_error).cast() }
                }
            },
        }
    }

    /// Returns the camera that renders one of `n_tiles` × `n_tiles` tiles of this camera's image, given as
    /// [column, row], with as many pixels as this camera has.
    pub(crate) fn tile(&self, n_tiles: usize, tile: [usize; 2]) -> Self {
        let slope = self.side as f32 / 2.0 / self.focal_px;
        let centre = |idx: usize| slope * (2.0 * idx as f32 + 1.0 - n_tiles as f32) / n_tiles as f32;
        Self { focal_px: self.focal_px * n_tiles as f32, image_centre: tile.map(centre), ..self.clone() }
    }

    /// Returns the shear that moves the image centre onto the optical axis and preserves depth, or `None` if
    /// it lies there already. Its result is called the centred frame.
    pub(crate) fn centring_shear(&self) -> Option<Affine3> {
        let [x, y] = self.image_centre;
        let linear = [[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]];
        (self.image_centre != [0.0; 2]).then_some(Affine3 { linear, offset: [0.0; 3] })
    }

    /// Returns, per unit of radius, the largest distance along x or y in the centred frame by which the
    /// centre of a sphere may lie outside an image edge of this slope while the sphere still intersects the
    /// frustum. The last factor compensates for the lengths that the shear shortens.
    #[inline(always)]
    pub(crate) fn sphere_margin(&self, slope: f32) -> f32 {
        let [x, y] = self.image_centre.map(f32::abs);
        let steepest = slope + x.max(y);
        (1.0 + steepest * steepest).sqrt() * (1.0 + x + y)
    }

    /// Returns `true` if a sphere in the mesh frame may intersect the view frustum. The transform leads to
    /// the centred frame. The test is conservative.
    #[inline(always)]
    pub(crate) fn may_intersect_sphere(&self, view_from_mesh: &Affine3, centre: Vec3, radius: f32) -> bool {
        let [x, y, z] = view_from_mesh.transform_point(centre);
        let radius = radius * view_from_mesh.max_scale();
        let slope = self.side as f32 / 2.0 / self.focal_px;
        let slack = radius * self.sphere_margin(slope);
        let [near_m, far_m] = self.clip_m;
        z + radius >= near_m
            && z - radius <= far_m
            && x.abs() - slope * z <= slack
            && y.abs() - slope * z <= slack
    }

    /// Returns `true` if the camera does not move within an episode.
    pub(crate) fn is_static(&self) -> bool {
        matches!(self.mount, Mount::World(_))
    }

    /// Returns the transform from the world to the view frame.
    pub(crate) fn view_from_world(&self, snapshot: &Snapshot) -> Affine3 {
        let pose = match &self.mount {
            Mount::World(pose) => *pose,
            Mount::Hand { arm, pose } => snapshot.arms[*arm][Link::Hand as usize] * pose,
        };
        let Affine3 { linear: [forward, left, up], offset: [x, y, z] } =
            Affine3::from_pose(&pose).rigid_inverse();
        Affine3 { linear: [scaled(left, -1.0), scaled(up, -1.0), forward], offset: [-y, -z, x] }
    }
}

/// Returns the pose of a camera at `eye` that looks at `target` with +z up. A camera that looks straight up
/// or down has +y on its left.
fn look_at(eye: [f64; 3], target: [f64; 3]) -> Isometry3<f64> {
    let eye = Vector3::from(eye);
    let forward = (Vector3::from(target) - eye).normalize();
    let sideways = Vector3::z().cross(&forward);
    let left = sideways.try_normalize(1e-9).unwrap_or_else(Vector3::y);
    let up = forward.cross(&left);
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[forward, left, up]));
    Isometry3::from_parts(Translation3::from(eye), UnitQuaternion::from_rotation_matrix(&axes))
}

//! Pinhole cameras. Camera frame: x forward, y left, z up. View frame, in which images are rendered: x right,
//! y down, z forward. Both are in m.

use ipc_types::{ImageSize, ImageSizes};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::math::affine::{Affine3, scaled};
use crate::math::trig::sin_cos;
use scene::{self, CameraMount, CameraSlot, Link, Snapshot};

/// A pinhole camera with square pixels.
#[derive(Clone, PartialEq)]
pub(crate) struct PinholeCamera {
    pub(crate) size: ImageSize,
    /// Focal length, in pixels.
    pub(crate) focal_px: f32,
    /// Depths of the near and far clipping planes, in m.
    pub(crate) clip_m: [f32; 2],
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
    /// Creates the camera of a sampled scene, including its pose error. Its vertical field of view does not
    /// depend on the size of the image.
    pub(crate) fn new(camera: &scene::Camera, sizes: ImageSizes) -> Self {
        let size = match camera.slot {
            CameraSlot::External1 | CameraSlot::External2 => sizes.external,
            CameraSlot::Hand1 | CameraSlot::Hand2 => sizes.hand,
        };
        let (sin, cos) = sin_cos(camera.fov_y_rad / 2.0);
        Self {
            size,
            focal_px: (size.height as f64 / 2.0 * cos / sin) as f32,
            clip_m: camera.clip_m.map(|c| c as f32),
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

    /// Returns half the width and half the height of the image, in pixels.
    pub(crate) fn half_px(&self) -> [f32; 2] {
        [self.size.width as f32 / 2.0, self.size.height as f32 / 2.0]
    }

    /// Returns the largest |x/z| and |y/z| inside the image.
    pub(crate) fn slopes(&self) -> [f32; 2] {
        self.half_px().map(|half_px| half_px / self.focal_px)
    }

    /// Returns, per unit of radius, the largest distance along x and y by which the centre of a sphere may
    /// lie outside an edge of the image while the sphere still intersects the frustum.
    pub(crate) fn sphere_margins(&self) -> [f32; 2] {
        self.slopes().map(|slope| (1.0 + slope * slope).sqrt())
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

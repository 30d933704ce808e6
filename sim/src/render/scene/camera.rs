//! Pinhole cameras. Camera frame: x forward, y left, z up. View frame, in which pictures are made: x right, y down,
//! z forward, in m.

use ipc_types::{EXTERNAL_SIDE, HAND_SIDE};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::render::math::affine::{Affine3, Vec3, scaled};
use crate::render::math::trig::sin_cos;
use crate::scene::{self, CameraMount, CameraSlot, Link, Snapshot};

/// A camera of a scene.
#[derive(Clone, PartialEq)]
pub(in crate::render) struct PinholeCamera {
    /// Pixels along each edge of its image.
    pub(in crate::render) side: usize,
    /// Pixels per unit of x/z in the view frame.
    pub(in crate::render) focal_px: f32,
    /// Nearest and farthest depth that is drawn, in m.
    pub(in crate::render) clip_m: [f32; 2],
    /// x/z and y/z of the image's middle: of a part of an image it is not on the axis.
    pub(in crate::render) middle: [f32; 2],
    mount: Mount,
}

#[derive(Clone, PartialEq)]
enum Mount {
    /// Pose in the world.
    World(Isometry3<f32>),
    /// Pose in the frame of an arm's hand.
    Hand { arm: usize, pose: Isometry3<f32> },
}

impl PinholeCamera {
    /// The camera as drawn, its error applied.
    pub(in crate::render) fn new(camera: &scene::Camera) -> Self {
        let side = match camera.slot {
            CameraSlot::External1 | CameraSlot::External2 => EXTERNAL_SIDE,
            CameraSlot::Hand1 | CameraSlot::Hand2 => HAND_SIDE,
        };
        let (sin, cos) = sin_cos(camera.fov_y_rad / 2.0);
        Self {
            side,
            focal_px: (side as f64 / 2.0 * cos / sin) as f32,
            clip_m: camera.clip_m.map(|c| c as f32),
            middle: [0.0; 2],
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

    /// The camera that sees one of `times` × `times` parts of its image, by column and row, in as many pixels.
    pub(in crate::render) fn part(&self, times: usize, window: [usize; 2]) -> Self {
        let slope = self.side as f32 / 2.0 / self.focal_px;
        let middle = |place: usize| slope * (2.0 * place as f32 + 1.0 - times as f32) / times as f32;
        Self { focal_px: self.focal_px * times as f32, middle: window.map(middle), ..self.clone() }
    }

    /// What makes the view frame one in which the image's middle is on the axis; nothing if it is there anyway. Depths stay.
    pub(in crate::render) fn centring_shear(&self) -> Option<Affine3> {
        let [x, y] = self.middle;
        let linear = [[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]];
        (self.middle != [0.0; 2]).then_some(Affine3 { linear, offset: [0.0; 3] })
    }

    /// How far beyond an edge of the image, of this slope, a ball's centre may lie for the ball to reach in: along x or y in
    /// the centred frame, per radius. The last factor makes up for lengths that centring shortens.
    #[inline(always)]
    pub(in crate::render) fn slant(&self, slope: f32) -> f32 {
        let [x, y] = self.middle.map(f32::abs);
        let steepest = slope + x.max(y);
        (1.0 + steepest * steepest).sqrt() * (1.0 + x + y)
    }

    /// Whether something within a ball of a mesh's frame may be on the image; the map is to the centred frame.
    #[inline(always)]
    pub(in crate::render) fn may_intersect_sphere(
        &self,
        view_from_mesh: &Affine3,
        centre: Vec3,
        radius: f32,
    ) -> bool {
        let [x, y, z] = view_from_mesh.point(centre);
        let radius = radius * view_from_mesh.max_scale();
        let slope = self.side as f32 / 2.0 / self.focal_px;
        let slack = radius * self.slant(slope);
        let [near_m, far_m] = self.clip_m;
        z + radius >= near_m
            && z - radius <= far_m
            && x.abs() - slope * z <= slack
            && y.abs() - slope * z <= slack
    }

    /// Whether it stands still within an episode.
    pub(in crate::render) fn stands(&self) -> bool {
        matches!(self.mount, Mount::World(_))
    }

    /// From the world to the view frame.
    pub(in crate::render) fn view_from_world(&self, snapshot: &Snapshot) -> Affine3 {
        let pose = match &self.mount {
            Mount::World(pose) => *pose,
            Mount::Hand { arm, pose } => snapshot.arms[*arm][Link::Hand as usize] * pose,
        };
        let Affine3 { linear: [forward, left, up], offset: [x, y, z] } =
            Affine3::from_pose(&pose).rigid_inverse();
        Affine3 { linear: [scaled(left, -1.0), scaled(up, -1.0), forward], offset: [-y, -z, x] }
    }
}

/// Pose of a camera at `eye` that looks at `target` with +z up; one that looks straight up or down has +y on its left.
fn look_at(eye: [f64; 3], target: [f64; 3]) -> Isometry3<f64> {
    let eye = Vector3::from(eye);
    let forward = (Vector3::from(target) - eye).normalize();
    let sideways = Vector3::z().cross(&forward);
    let left = sideways.try_normalize(1e-9).unwrap_or_else(Vector3::y);
    let up = forward.cross(&left);
    let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[forward, left, up]));
    Isometry3::from_parts(Translation3::from(eye), UnitQuaternion::from_rotation_matrix(&axes))
}

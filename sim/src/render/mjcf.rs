//! Scenes for another renderer: MuJoCo's XML with OBJ meshes and PNG textures, and where everything is in it.
//!
//! Triangles, texture coordinates, cameras and the directions of lights are ours. Light falls by MuJoCo's own rules, so
//! that its pictures look alike but are not equal. Every instance is a mocap body of its own, and so is every camera.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::Path;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::affine::{Affine, Vec3, normalised, scaled};
use super::material::Material;
use super::mesh::Facing;
use super::rules::{MAP_M, MAP_SIDE};
use super::scene::{Instance, RenderScene};
use super::texture::{self, SIDE};
use crate::scene::Snapshot;

impl RenderScene {
    /// Writes `scene.xml` and what it refers to into a directory.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_mjcf(&self, dir: &Path) -> io::Result<()> {
        for (i, instance) in self.instances.iter().enumerate() {
            write_obj(instance, BufWriter::new(File::create(dir.join(format!("{i}.obj")))?))?;
            if let Some(pattern) = instance.material.texture {
                let texels = &texture::pattern(pattern).texels;
                write_texture(texels, &dir.join(format!("{i}.png")))?;
            }
        }
        fs::write(dir.join("scene.xml"), self.mjcf())
    }

    /// Poses of the mocap bodies of `scene.xml` in the world, in their order: position in m, then quaternion (w, x, y, z).
    #[must_use]
    pub fn mjcf_poses(&self, snapshot: &Snapshot) -> Vec<[f32; 7]> {
        let instances = self.instances.iter().map(|instance| {
            let mut map = instance.world_from_mesh(snapshot);
            for row in &mut map.linear {
                *row = core::array::from_fn(|axis| row[axis] / instance.scale[axis]);
            }
            pose(&map)
        });
        // A camera of MuJoCo's has x right, y up and z backward.
        let cameras = self.cameras.iter().map(|camera| {
            let mut map = camera.view_from_world(snapshot).rigid_inverse();
            for row in &mut map.linear {
                *row = [row[0], -row[1], -row[2]];
            }
            pose(&map)
        });
        instances.chain(cameras).collect()
    }

    fn mjcf(&self) -> String {
        let (mut assets, mut bodies) = (String::new(), String::new());
        for (i, instance) in self.instances.iter().enumerate() {
            let Material { color, specular, texture } = instance.material;
            let texture = if texture.is_some() {
                line(&mut assets, &format!(r#"<texture name="t{i}" type="2d" file="{i}.png"/>"#));
                format!(r#"texture="t{i}" "#)
            } else {
                String::new()
            };
            let [r, g, b] = color.map(f32::sqrt);
            line(
                &mut assets,
                &format!(r#"<material name="m{i}" {texture}rgba="{r} {g} {b} 1" specular="{specular}"/>"#),
            );
            line(&mut assets, &format!(r#"<mesh name="o{i}" file="{i}.obj" inertia="shell"/>"#));
            line(
                &mut bodies,
                &format!(
                    r#"<body mocap="true"><geom type="mesh" mesh="o{i}" material="m{i}" contype="0" conaffinity="0"/></body>"#
                ),
            );
        }
        for (i, camera) in self.cameras.iter().enumerate() {
            let fovy = 2.0 * (camera.side as f32 / 2.0 / camera.focal_px).atan().to_degrees();
            line(&mut bodies, &format!(r#"<body mocap="true"><camera name="c{i}" fovy="{fovy}"/></body>"#));
        }
        for (i, sun) in self.suns.iter().enumerate() {
            let ([x, y, z], [r, g, b]) =
                (scaled(sun.towards, -1.0), sun.color.map(|c| (c / core::f32::consts::PI).sqrt()));
            let [red, green, blue] = if i == 0 { self.ambient.map(f32::sqrt) } else { [0.0; 3] };
            let casts = i == 0;
            line(
                &mut bodies,
                &format!(
                    r#"<light type="directional" dir="{x} {y} {z}" diffuse="{r} {g} {b}" ambient="{red} {green} {blue}" castshadow="{casts}"/>"#
                ),
            );
        }
        let side = self.cameras.iter().map(|camera| camera.side).max().unwrap_or(1);
        let [near_m, far_m] = self.cameras.first().map_or([0.01, 100.0], |camera| camera.clip_m);
        let shadow_clip = MAP_M / 2.0;
        format!(
            r#"<mujoco>
  <statistic extent="1" center="0 0 0.3"/>
  <visual>
    <global offwidth="{side}" offheight="{side}"/>
    <quality shadowsize="{MAP_SIDE}" offsamples="0"/>
    <headlight active="0"/>
    <map znear="{near_m}" zfar="{far_m}" shadowclip="{shadow_clip}"/>
  </visual>
  <asset>
{assets}  </asset>
  <worldbody>
{bodies}  </worldbody>
</mujoco>
"#
        )
    }
}

fn line(text: &mut String, element: &str) {
    writeln!(text, "    {element}").expect("a String takes all");
}

/// Position and quaternion of a rigid motion.
fn pose(map: &Affine) -> [f32; 7] {
    let matrix = Matrix3::from_fn(|row, column| map.linear[row][column]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let [x, y, z] = map.offset;
    [x, y, z, turn.w, turn.i, turn.j, turn.k]
}

/// The instance's mesh at its drawn size, with a texture coordinate for each vertex and facing.
fn write_obj(instance: &Instance, mut out: impl io::Write) -> io::Result<()> {
    let (mesh, scale) = (instance.mesh(), instance.scale);
    let per_m = instance.material.texture.map_or(1.0, |pattern| 1.0 / texture::pattern(pattern).tile_m);
    for i in 0..mesh.n_vertices() as u32 {
        let [x, y, z]: Vec3 = scaled_by(mesh.position(i), scale);
        let [nx, ny, nz] = normalised(scaled_by(mesh.normals[i as usize], scale.map(|s| 1.0 / s)));
        writeln!(out, "v {x} {y} {z}\nvn {nx} {ny} {nz}")?;
        for [u, v] in [[z, y], [x, z], [x, y]] {
            writeln!(out, "vt {} {}", u * per_m, v * per_m)?;
        }
    }
    for (corners, facing) in mesh.triangles.iter().zip(&mesh.facing) {
        let along = match facing {
            Facing::X => 0,
            Facing::Y => 1,
            Facing::Z => 2,
        };
        let [a, b, c] = corners.map(|i| format!("{0}/{1}/{0}", i + 1, 3 * i + along + 1));
        writeln!(out, "f {a} {b} {c}")?;
    }
    out.flush()
}

fn scaled_by(v: Vec3, scale: Vec3) -> Vec3 {
    core::array::from_fn(|axis| v[axis] * scale[axis])
}

/// The finest level of a pattern.
fn write_texture(texels: &[u32], path: &Path) -> io::Result<()> {
    let rows = texels.chunks_exact(texture::pitch(0)).take(SIDE);
    let bytes: Vec<u8> = rows
        .flat_map(|row| &row[..SIDE])
        .flat_map(|texel| {
            let [r, g, b, _] = texel.to_le_bytes();
            [r, g, b]
        })
        .collect();
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(path)?), SIDE as u32, SIDE as u32);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    writer.write_image_data(&bytes).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}

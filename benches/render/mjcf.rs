//! Export of scenes to MuJoCo: an MJCF file with OBJ meshes and PNG textures.
//!
//! Triangles, texture coordinates, cameras and light directions are those of our renderer. MuJoCo shades by
//! its own model, so its images look similar but are not equal. Every instance and every camera is a mocap
//! body of its own.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::Path;

use sim::render::export::{ExportedInstance, ExportedScene, ExportedTexture};

/// Writes `scene.xml` and the meshes and textures it refers to into a directory. The mocap bodies are the
/// instances, followed by the cameras.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn write(scene: &ExportedScene, dir: &Path) -> io::Result<()> {
    for (i, instance) in scene.instances.iter().enumerate() {
        write_obj(instance, BufWriter::new(File::create(dir.join(format!("{i}.obj")))?))?;
        if let Some(texture) = &instance.texture {
            write_texture(texture, &dir.join(format!("{i}.png")))?;
        }
    }
    fs::write(dir.join("scene.xml"), scene_xml(scene))
}

fn scene_xml(scene: &ExportedScene) -> String {
    let (mut assets, mut bodies) = (String::new(), String::new());
    for (i, instance) in scene.instances.iter().enumerate() {
        add_instance(&mut assets, &mut bodies, i, instance);
    }
    for (i, camera) in scene.cameras.iter().enumerate() {
        let fovy = camera.fov_y_rad.to_degrees();
        push_line(&mut bodies, &format!(r#"<body mocap="true"><camera name="c{i}" fovy="{fovy}"/></body>"#));
    }
    for (i, light) in scene.lights.iter().enumerate() {
        let ([x, y, z], [r, g, b]) =
            (light.towards.map(|c| -c), light.color.map(|c| (c / core::f32::consts::PI).sqrt()));
        let [red, green, blue] = if i == 0 { scene.ambient.map(f32::sqrt) } else { [0.0; 3] };
        let casts = i == 0;
        push_line(
            &mut bodies,
            &format!(
                r#"<light type="directional" dir="{x} {y} {z}" diffuse="{r} {g} {b}" ambient="{red} {green} {blue}" castshadow="{casts}"/>"#
            ),
        );
    }
    let side = scene.cameras.iter().map(|camera| camera.size.height).max().unwrap_or(1);
    let [near_m, far_m] = scene.cameras.first().map_or([0.01, 100.0], |camera| camera.clip_m);
    let shadow_clip = scene.shadow_map_width_m / 2.0;
    let shadow_size = scene.shadow_map_side;
    format!(
        r#"<mujoco>
  <statistic extent="1" center="0 0 0.3"/>
  <visual>
    <global offwidth="{side}" offheight="{side}"/>
    <quality shadowsize="{shadow_size}" offsamples="0"/>
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

fn add_instance(assets: &mut String, bodies: &mut String, i: usize, instance: &ExportedInstance) {
    let specular = instance.specular;
    let texture = if instance.texture.is_some() {
        push_line(assets, &format!(r#"<texture name="t{i}" type="2d" file="{i}.png"/>"#));
        format!(r#"texture="t{i}" "#)
    } else {
        String::new()
    };
    let [r, g, b] = instance.color.map(f32::sqrt);
    push_line(
        assets,
        &format!(r#"<material name="m{i}" {texture}rgba="{r} {g} {b} 1" specular="{specular}"/>"#),
    );
    push_line(assets, &format!(r#"<mesh name="o{i}" file="{i}.obj" inertia="shell"/>"#));
    push_line(
        bodies,
        &format!(
            r#"<body mocap="true"><geom type="mesh" mesh="o{i}" material="m{i}" contype="0" conaffinity="0"/></body>"#
        ),
    );
}

fn push_line(text: &mut String, element: &str) {
    writeln!(text, "    {element}").expect("writing to a String cannot fail");
}

/// Writes an OBJ file with one texture coordinate per vertex and projection axis.
fn write_obj(instance: &ExportedInstance, mut out: impl io::Write) -> io::Result<()> {
    let tiles_per_m = instance.texture.as_ref().map_or(1.0, |texture| 1.0 / texture.tile_m);
    for ([x, y, z], [nx, ny, nz]) in instance.positions.iter().zip(&instance.normals) {
        writeln!(out, "v {x} {y} {z}\nvn {nx} {ny} {nz}")?;
        for [u, v] in [[z, y], [x, z], [x, y]] {
            writeln!(out, "vt {} {}", u * tiles_per_m, v * tiles_per_m)?;
        }
    }
    for (corners, axis) in instance.triangles.iter().zip(&instance.texture_axes) {
        let [a, b, c] = corners.map(|i| format!("{0}/{1}/{0}", i + 1, 3 * i as usize + axis + 1));
        writeln!(out, "f {a} {b} {c}")?;
    }
    out.flush()
}

fn write_texture(texture: &ExportedTexture, path: &Path) -> io::Result<()> {
    let side = texture.side as u32;
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(path)?), side, side);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    writer.write_image_data(&texture.rgb).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}

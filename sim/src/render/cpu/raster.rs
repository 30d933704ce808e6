//! Which triangle each pixel sees: exact coverage in integers, the nearest by 1/depth.

use crate::render::camera::Camera;

/// Greatest side of an image.
pub(super) const MAX_SIDE: usize = 224;
/// Pixels worked on together.
const LANES: usize = 8;
/// No triangle.
pub(super) const NOTHING: u32 = u32::MAX;

/// A corner of a triangle on the image.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    /// 1/256 pixel from the left edge, between about ±2¹⁸.
    pub(super) x: i32,
    /// 1/256 pixel from the upper edge.
    pub(super) y: i32,
    /// 1/depth, in 1/m.
    pub(super) inverse_z: f32,
}

/// The nearest triangle of every pixel.
pub(super) struct Visibility {
    side: usize,
    /// 1/depth of the nearest, in 1/m; `side * side` are in use.
    inverse_z: Vec<f32>,
    /// What was drawn there, or [`NOTHING`].
    pub(super) ids: Vec<u32>,
}

impl Visibility {
    /// Room for the largest image.
    pub(super) fn new() -> Self {
        Self { side: 0, inverse_z: vec![0.0; MAX_SIDE * MAX_SIDE], ids: vec![NOTHING; MAX_SIDE * MAX_SIDE] }
    }

    /// An empty image of the camera's size, at its far plane.
    #[inline(always)]
    pub(super) fn clear(&mut self, camera: &Camera) {
        assert!(camera.side <= MAX_SIDE && camera.side.is_multiple_of(LANES), "side {}", camera.side);
        self.side = camera.side;
        let n = self.side * self.side;
        self.inverse_z[..n].fill(1.0 / camera.clip_m[1]);
        self.ids[..n].fill(NOTHING);
    }

    /// Draws a triangle unless it is seen from behind.
    #[inline(always)]
    pub(super) fn draw(&mut self, id: u32, [p, q, r]: [Corner; 3]) {
        // Outsides are counter-clockwise to the eye, which is clockwise in numbers, as y runs down: exchanging two
        // corners makes all three edge functions positive inside.
        let corners = [p, r, q];
        let Some(setup) = Setup::new(&corners, self.side as i32) else {
            return;
        };
        let [s0, s1, s2] = [&setup.edges[0], &setup.edges[1], &setup.edges[2]].map(Edge::steps);
        let z_steps = setup.z.steps();
        for y in setup.from_y..=setup.to_y {
            let (from_x, to_x) = setup.span(y);
            let from_x = from_x & !(LANES as i32 - 1);
            let mut at =
                [setup.edges[0].at(from_x, y), setup.edges[1].at(from_x, y), setup.edges[2].at(from_x, y)];
            for x in (from_x..=to_x).step_by(LANES) {
                let [at0, at1, at2] = at;
                for (at, edge) in at.iter_mut().zip(&setup.edges) {
                    *at = at.wrapping_add(edge.dx.wrapping_mul(LANES as i32));
                }
                let start = y as usize * self.side + x as usize;
                let z_at = setup.z.at(x, y);
                let depths: &mut [f32; LANES] =
                    (&mut self.inverse_z[start..start + LANES]).try_into().expect("LANES long");
                let ids: &mut [u32; LANES] =
                    (&mut self.ids[start..start + LANES]).try_into().expect("LANES long");
                for i in 0..LANES {
                    let inside = at0.wrapping_add(s0[i]) | at1.wrapping_add(s1[i]) | at2.wrapping_add(s2[i]);
                    let steep = z_at + z_steps[i];
                    let z = if steep > setup.z.least { steep } else { setup.z.least };
                    let z = if z < setup.z.greatest { z } else { setup.z.greatest };
                    let seen = (inside >= 0) & (z > depths[i]);
                    depths[i] = if seen { z } else { depths[i] };
                    ids[i] = if seen { id } else { ids[i] };
                }
            }
        }
    }
}

/// A triangle made ready to be filled.
struct Setup {
    edges: [Edge; 3],
    z: Depth,
    from_x: i32,
    to_x: i32,
    from_y: i32,
    to_y: i32,
}

/// An edge function at pixel centres, not negative where the pixel is on the inner side. In units of 256/256² pixel²:
/// pixel centres are whole pixels apart, so the part below such a unit never decides and is shifted out.
struct Edge {
    /// At the centre of pixel (0, 0).
    origin: i32,
    dx: i32,
    dy: i32,
}

/// 1/depth as a plane over the pixels, held within the triangle's own range where the plane is steep.
struct Depth {
    /// At the first corner.
    corner: f32,
    /// From there to the centre of pixel (0, 0), in px.
    from_corner: [f32; 2],
    dx: f32,
    dy: f32,
    least: f32,
    greatest: f32,
}

impl Setup {
    /// `None` if the corners run the other way round or no pixel centre is near.
    #[inline(always)]
    fn new(corners: &[Corner; 3], side: i32) -> Option<Self> {
        let [p, q, r] = corners;
        let (qx, qy) = (i64::from(q.x - p.x), i64::from(q.y - p.y));
        let (rx, ry) = (i64::from(r.x - p.x), i64::from(r.y - p.y));
        let area = qx * ry - rx * qy;
        if area <= 0 {
            return None;
        }
        // Pixel i has its centre at 256 i + 128.
        let first = |a: i32, b: i32, c: i32| ((a.min(b).min(c) + 127) >> 8).max(0);
        let last = |a: i32, b: i32, c: i32| ((a.max(b).max(c) - 128) >> 8).min(side - 1);
        let (from_x, to_x) = (first(p.x, q.x, r.x), last(p.x, q.x, r.x));
        let (from_y, to_y) = (first(p.y, q.y, r.y), last(p.y, q.y, r.y));
        if from_x > to_x || from_y > to_y {
            return None;
        }
        let edges = [Edge::new(p, q), Edge::new(q, r), Edge::new(r, p)];
        let depth = Depth::new(corners, [qx, qy, rx, ry].map(|d| d as f32), area as f32);
        Some(Self { edges, z: depth, from_x, to_x, from_y, to_y })
    }
}

impl Setup {
    /// First and last column of a row that the triangle may cover: near enough, the edge functions decide.
    #[inline(always)]
    fn span(&self, y: i32) -> (i32, i32) {
        let (mut from, mut to) = (self.from_x, self.to_x);
        if to - from >= 4 * LANES as i32 {
            for edge in &self.edges {
                let crossing = -edge.at(0, y) as f32 / edge.dx as f32;
                if edge.dx > 0 {
                    from = from.max(crossing as i32 - 1);
                } else if edge.dx < 0 {
                    to = to.min(crossing as i32 + 1);
                }
            }
        }
        (from, to)
    }
}

impl Edge {
    #[inline(always)]
    fn new(p: &Corner, q: &Corner) -> Self {
        let (dx, dy) = (q.x - p.x, q.y - p.y);
        // A centre on the edge belongs to the triangle if the edge is at its top or left.
        let bias = i64::from(!(dy < 0 || (dy == 0 && dx > 0)));
        let origin = i64::from(dx) * i64::from(128 - p.y) - i64::from(dy) * i64::from(128 - p.x) - bias;
        Self { origin: (origin >> 8) as i32, dx: -dy, dy: dx }
    }

    #[inline(always)]
    fn at(&self, x: i32, y: i32) -> i32 {
        self.origin + self.dx * x + self.dy * y
    }

    /// Changes from a group's first pixel to each of its pixels.
    #[inline(always)]
    fn steps(&self) -> [i32; LANES] {
        let mut steps = [0; LANES];
        for i in 1..LANES {
            steps[i] = steps[i - 1] + self.dx;
        }
        steps
    }
}

impl Depth {
    #[inline(always)]
    fn new([p, q, r]: &[Corner; 3], [qx, qy, rx, ry]: [f32; 4], area: f32) -> Self {
        let (q_rise, r_rise) = (q.inverse_z - p.inverse_z, r.inverse_z - p.inverse_z);
        // Per pixel, hence the 256.
        let scale = 256.0 / area;
        let dx = (q_rise * ry - r_rise * qy) * scale;
        let dy = (r_rise * qx - q_rise * rx) * scale;
        let centre_from = |t: i32| (128 - t) as f32 / 256.0;
        Self {
            corner: p.inverse_z,
            from_corner: [centre_from(p.x), centre_from(p.y)],
            dx,
            dy,
            least: p.inverse_z.min(q.inverse_z).min(r.inverse_z),
            greatest: p.inverse_z.max(q.inverse_z).max(r.inverse_z),
        }
    }

    #[inline(always)]
    fn at(&self, x: i32, y: i32) -> f32 {
        let [from_x, from_y] = self.from_corner;
        self.corner + self.dx * (x as f32 + from_x) + self.dy * (y as f32 + from_y)
    }

    /// Changes from a group's first pixel to each of its pixels.
    #[inline(always)]
    fn steps(&self) -> [f32; LANES] {
        let mut steps = [0.0; LANES];
        for (i, step) in steps.iter_mut().enumerate() {
            *step = self.dx * i as f32;
        }
        steps
    }
}

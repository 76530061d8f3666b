//! What the tests share: PushT scenes as the golden files describe them, their drawing, and where the files are.
//!
//! The drawing is the tests' own: it says in primitives what the environment's drawing code will say.

use std::io::Read;
use std::path::PathBuf;

use serde::Deserialize;
use swm_render::{Painter, Rgb, light};

/// One golden scene.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Scene {
    pub(crate) bg: Rgb,
    pub(crate) goalc: Rgb,
    pub(crate) agentc: Rgb,
    pub(crate) blockc: Rgb,
    /// x, y, angle.
    pub(crate) goal: [f64; 3],
    pub(crate) render_goal: u8,
    pub(crate) agent: Body,
    pub(crate) block: Body,
    /// Contact lines: x, y, x, y, and the color with alpha.
    pub(crate) segs: Vec<[f64; 8]>,
}

#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Body {
    /// Of the local origin.
    pub(crate) pos: [f64; 2],
    pub(crate) angle: f64,
    pub(crate) shapes: Vec<Part>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Part {
    /// x, y, radius.
    Circle([f64; 3]),
    Poly(Vec<[f64; 2]>),
}

const WALLS: [[[f64; 2]; 2]; 4] = [
    [[5.0, 506.0], [5.0, 5.0]],
    [[5.0, 5.0], [506.0, 5.0]],
    [[506.0, 5.0], [506.0, 506.0]],
    [[5.0, 506.0], [506.0, 506.0]],
];

impl Scene {
    pub(crate) fn draw_background(&self, p: &mut dyn Painter) {
        p.fill(self.bg);
        if self.render_goal == 1 {
            for part in &self.block.shapes {
                if let Part::Poly(vertices) = part {
                    p.polygon(&place(vertices, [self.goal[0], self.goal[1]], self.goal[2]), self.goalc);
                }
            }
        }
    }

    pub(crate) fn draw_rest(&self, p: &mut dyn Painter) {
        let agent = self.agent.shapes.iter().map(|part| (part, &self.agent, self.agentc));
        let block = self.block.shapes.iter().map(|part| (part, &self.block, self.blockc));
        let mut parts: Vec<_> = agent.chain(block).collect();
        if parts.len() <= 4 {
            parts.rotate_left(1);
        }
        for (part, body, color) in parts {
            draw_part(p, part, body, color);
        }
        for [from, to] in WALLS {
            p.fat_segment(from, to, [211, 211, 211]);
        }
        for [x1, y1, x2, y2, r, g, b, _] in &self.segs {
            p.aa_line([*x1, *y1], [*x2, *y2], [*r as u8, *g as u8, *b as u8]);
        }
    }
}

fn draw_part(p: &mut dyn Painter, part: &Part, body: &Body, color: Rgb) {
    match part {
        Part::Circle([x, y, radius]) => {
            let [center] = place(&[[*x, *y]], body.pos, body.angle)[..] else { unreachable!("one point") };
            p.disc(center, *radius, color);
            p.disc(center, *radius - 4.0, light(color));
        }
        Part::Poly(vertices) => {
            let vertices = place(vertices, body.pos, body.angle);
            p.polygon(&vertices, light(color));
            for (from, to) in vertices.iter().zip(vertices.iter().cycle().skip(1)) {
                p.fat_segment(*from, *to, color);
            }
        }
    }
}

fn place(points: &[[f64; 2]], origin: [f64; 2], angle: f64) -> Vec<[f64; 2]> {
    let (sin, cos) = angle.sin_cos();
    points.iter().map(|[x, y]| [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y]).collect()
}

/// The folder of golden images: `SWM_GOLDEN_DIR`, or the committed ones.
pub(crate) fn golden_dir() -> PathBuf {
    std::env::var_os("SWM_GOLDEN_DIR").map_or_else(committed_dir, PathBuf::from)
}

pub(crate) fn committed_dir() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/render")
}

/// A golden scene with the reference's canvas `[512, 512, 3]` and image `[224, 224, 3]`.
pub(crate) struct Golden {
    pub(crate) scene: Scene,
    pub(crate) canvas: Vec<u8>,
    pub(crate) image: Vec<u8>,
}

pub(crate) fn golden_scenes() -> Vec<Golden> {
    let dir = golden_dir().join("pusht");
    let json = std::fs::read_to_string(dir.join("pusht_frames.json")).expect("the scenes are readable");
    let scenes: Vec<Scene> = serde_json::from_str(&json).expect("the scenes have the schema");
    let file = std::fs::File::open(dir.join("pusht_frames.bin.gz")).expect("the frames are readable");
    let mut frames = flate2::read::GzDecoder::new(file);
    let mut take = |len: usize| {
        let mut bytes = vec![0; len];
        frames.read_exact(&mut bytes).expect("the frames are complete");
        bytes
    };
    let golden = |scene| Golden { scene, canvas: take(512 * 512 * 3), image: take(224 * 224 * 3) };
    scenes.into_iter().map(golden).collect()
}

/// A decoded `[H, W, 3]` image.
pub(crate) struct Image {
    pub(crate) height: usize,
    pub(crate) width: usize,
    pub(crate) rgb: Vec<u8>,
}

pub(crate) fn decode_png(bytes: &[u8]) -> Image {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG header");
    let mut rgb = vec![0; reader.output_buffer_size().expect("a sane size")];
    let info = reader.next_frame(&mut rgb).expect("PNG data");
    assert_eq!(info.color_type, png::ColorType::Rgb);
    rgb.truncate(info.buffer_size());
    Image { height: info.height as usize, width: info.width as usize, rgb }
}

//! A drawn scene that moves: what the crate is for, in small.

use swm_media::Clip;

/// `frames` frames of a disc that crosses two bars on a light ground, without anti-aliasing: 4 colors.
pub(crate) fn drawn(height: usize, width: usize, frames: usize) -> Clip {
    let mut clip = Clip::new(height, width, 10.0);
    for t in 0..frames {
        let center = [0.5 * height as f64, (0.2 + 0.05 * t as f64) * width as f64];
        let radius = 0.15 * height as f64;
        let frame = paint(height, width, |y, x| {
            let [dy, dx] = [y as f64 - center[0], x as f64 - center[1]];
            if dy.hypot(dx) < radius {
                [65, 105, 225]
            } else if x * 10 / width == 7 {
                [144, 238, 144]
            } else if y * 10 / height == 8 {
                [119, 136, 153]
            } else {
                [250, 250, 245]
            }
        });
        clip.push(&frame).unwrap();
    }
    clip
}

/// `frames` frames of a smooth gradient that drifts: thousands of colors.
pub(crate) fn gradient(height: usize, width: usize, frames: usize) -> Clip {
    let mut clip = Clip::new(height, width, 10.0);
    for t in 0..frames {
        let frame = paint(height, width, |y, x| {
            [
                (x * 255 / width) as u8,
                (y * 255 / height) as u8,
                ((x + y + 8 * t) * 100 / (height + width)) as u8,
            ]
        });
        clip.push(&frame).unwrap();
    }
    clip
}

fn paint(height: usize, width: usize, color: impl Fn(usize, usize) -> [u8; 3]) -> Vec<u8> {
    (0..height * width).flat_map(|i| color(i / width, i % width)).collect()
}

/// Peak signal-to-noise ratio of two frames, in dB.
pub(crate) fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares: f64 = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
    10.0 * (255.0_f64.powi(2) * a.len() as f64 / squares).log10()
}

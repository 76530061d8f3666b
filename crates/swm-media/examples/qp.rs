//! probe
use std::io::Cursor;
use std::time::Instant;
use swm_media::mp4::*;
fn main() {
    let side = 224;
    let n = 200;
    // drawn scene
    let mut frames = Vec::new();
    for t in 0..n {
        let mut f = Vec::with_capacity(side * side * 3);
        for i in 0..side * side {
            let (y, x) = ((i / side) as f64, (i % side) as f64);
            let c = [112.0, 20.0 + t as f64];
            let p = if (y - c[0]).hypot(x - c[1]) < 25.0 {
                [65, 105, 225]
            } else if x > 150.0 && x < 180.0 && y > 60.0 {
                [144, 238, 144]
            } else {
                [250, 250, 245]
            };
            f.extend(p);
        }
        frames.push(f);
    }
    for fast in [false, true] {
        for q in [0u8, 4, 8, 12, 18, 26, 40] {
            let o = Mp4Options { quantiser: q, is_fast: fast, ..Mp4Options::default() };
            let s = Instant::now();
            let b = encode_frames(frames.iter().map(Vec::as_slice), side, side, &o).unwrap();
            let e = s.elapsed().as_secs_f64();
            let mut out = vec![0; n * side * side * 3];
            let s = Instant::now();
            Mp4Reader::new(Cursor::new(&b)).unwrap().read(0, 1, &mut out).unwrap();
            let d = s.elapsed().as_secs_f64();
            let se: f64 =
                frames.iter().flatten().zip(&out).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
            println!(
                "fast {fast} q {q}: {} bytes, encode {:.0} f/s, decode {:.0} f/s, {:.2} dB",
                b.len(),
                n as f64 / e,
                n as f64 / d,
                10.0 * (65025.0 * out.len() as f64 / se).log10()
            );
        }
    }
    let s = Instant::now();
    for _ in 0..20 {
        encode_frames(frames[..1].iter().map(Vec::as_slice), side, side, &Mp4Options::default()).unwrap();
    }
    println!("one frame: {:?}", s.elapsed() / 20);
}

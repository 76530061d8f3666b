//! dev
use serde_json::Value;
use std::path::Path;
use swm_render::{Geometry, scene::*};
fn f3(v: &Value) -> [f64; 3] {
    [0, 1, 2].map(|i| v[i].as_f64().unwrap())
}
fn g3(v: &Value) -> [f32; 3] {
    f3(v).map(|x| x as f32)
}
fn bytes(p: &str) -> Vec<u8> {
    std::fs::read(p).unwrap_or_default()
}
fn f32s(p: &str) -> Vec<f32> {
    bytes(p).chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect()
}
fn i32s(p: &str) -> Vec<i32> {
    bytes(p).chunks_exact(4).map(|c| i32::from_le_bytes(c.try_into().unwrap())).collect()
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (name, size, reps) =
        (&a[1], a[2].parse::<usize>().unwrap(), a.get(3).map_or(0, |s| s.parse::<usize>().unwrap()));
    let newuv = true;
    let d = format!("/tmp/r3d/{name}");
    let j: Value = serde_json::from_slice(&bytes(&format!("{d}.json"))).unwrap();
    let mut assets = Assets::default();
    let tex = bytes(&format!("{d}.tex"));
    let mut slots = vec![];
    let mut sky = None;
    for t in j["textures"].as_array().unwrap() {
        let (w, h, adr, ty) = (
            t["w"].as_u64().unwrap() as usize,
            t["h"].as_u64().unwrap() as usize,
            t["adr"].as_u64().unwrap() as usize,
            t["type"].as_u64().unwrap(),
        );
        let data = &tex[adr..adr + w * h * 3];
        if ty == 0 {
            assets.textures.push(Texture::new(w, h, data).unwrap());
            slots.push((0, assets.textures.len() - 1));
        } else {
            assets.cubes.push(CubeTexture::new(w, data).unwrap());
            slots.push((1, assets.cubes.len() - 1));
            if ty == 2 && sky.is_none() {
                sky = Some(assets.cubes.len() - 1)
            }
        }
    }
    let (vert, norm, face, fnorm) = (
        f32s(&format!("{d}.vert")),
        f32s(&format!("{d}.normal")),
        i32s(&format!("{d}.face")),
        i32s(&format!("{d}.facenormal")),
    );
    for m in j["meshes"].as_array().unwrap() {
        let u = |k: &str| m[k].as_i64().unwrap() as usize;
        let pts: Vec<[f32; 3]> =
            (0..u("vertnum")).map(|i| [0, 1, 2].map(|k| vert[3 * (u("vertadr") + i) + k])).collect();
        let (mut tr, mut ns) = (vec![], vec![]);
        for f in u("faceadr")..u("faceadr") + u("facenum") {
            let t = [0, 1, 2].map(|k| face[3 * f + k] as u32);
            let p = t.map(|i| pts[i as usize]);
            let e = |a: [f32; 3], b: [f32; 3]| [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
            let (x, y) = (e(p[0], p[1]), e(p[0], p[2]));
            let mut n = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
            let l = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt().max(1e-20);
            n = n.map(|v| v / l);
            let c = [0, 1, 2].map(|k| {
                let q = [0, 1, 2].map(|i| norm[3 * (u("normaladr") + fnorm[3 * f + k] as usize) + i]);
                if q[0] * n[0] + q[1] * n[1] + q[2] * n[2] < 0.8 { n } else { q }
            });
            tr.push(t);
            ns.push(c);
        }
        assets.meshes.push(Mesh::new(pts, tr, ns).unwrap());
    }
    let c = &j["camera"];
    let near = c["near"].as_f64().unwrap();
    let n = |k: &str| c[k].as_f64().unwrap() / near;
    let camera = Camera {
        position: f3(&c["pos"]),
        forward: f3(&c["forward"]),
        up: f3(&c["up"]),
        projection: Projection { bottom: n("bottom"), top: n("top"), center: n("center"), half_width: None },
        near,
        far: c["far"].as_f64().unwrap(),
    };
    let vis = &j["vis"];
    let extent = vis["extent"].as_f64().unwrap();
    let lights = j["lights"]
        .as_array()
        .unwrap()
        .iter()
        .map(|l| {
            let sun = l["type"] == 1;
            let cut = l["cutoff"].as_f64().unwrap() as f32;
            let shadow = (l["castshadow"] == 1).then(|| {
                if sun {
                    vis["shadowclip"].as_f64().unwrap() * extent
                } else {
                    (((2.0 * f64::from(cut) * vis["shadowscale"].as_f64().unwrap()).min(160.0)) / 2.0)
                        .to_radians()
                        .tan()
                }
            });
            Light {
                kind: if sun {
                    LightKind::Sun
                } else {
                    LightKind::Spot {
                        cutoff: cut,
                        exponent: l["exponent"].as_f64().unwrap() as f32,
                        attenuation: g3(&l["attenuation"]),
                    }
                },
                direction: f3(&l["dir"]),
                position: f3(&l["pos"]),
                ambient: g3(&l["ambient"]),
                diffuse: g3(&l["diffuse"]),
                specular: g3(&l["specular"]),
                shadow,
            }
        })
        .collect();
    let mut instances = vec![];
    for g in j["geoms"].as_array().unwrap() {
        let ty = g["type"].as_i64().unwrap();
        let s = g3(&g["size"]);
        let m = &g["mat"];
        let rotation = [0, 1, 2].map(|r| [0, 1, 2].map(|k| m[3 * r + k].as_f64().unwrap()));
        let dataid = g["dataid"].as_i64().unwrap();
        let shape = match ty {
            0 => {
                let p = f3(&j["planes"][dataid.max(0) as usize]["size"]);
                Shape::Plane {
                    half: [s[0], s[1]],
                    cell: [0, 1].map(|k| (2.0 * p[2].max(p[k] / 198.0)) as f32),
                }
            }
            2 | 4 => Shape::Ellipsoid { radii: s },
            3 => Shape::Capsule { radius: s[0], half: s[2] },
            5 => Shape::Cylinder { radius: s[0], half: s[2] },
            6 => Shape::Box { half: s },
            7 => Shape::Mesh(dataid as usize / 2),
            _ => {
                println!("skip {ty}");
                continue;
            }
        };
        let texid = g["texid"].as_i64().unwrap();
        let uni = g["texuniform"] == 1;
        let rep = [0, 1].map(|k| g["texrepeat"][k].as_f64().unwrap() as f32);
        let texture = (texid >= 0).then(|| {
            let (kind, slot) = slots[texid as usize];
            if kind == 0 {
                if newuv {
                    // u=(x+s)/(2s)*repeat*(s if uniform), v=(1-(y+s)/(2s))*...
                    let r = [0, 1].map(|k| rep[k] * if uni { s[k] } else { 1.0 });
                    Mapping::Flat {
                        texture: slot,
                        scale: [r[0] / (2.0 * s[0]), -r[1] / (2.0 * s[1])],
                        offset: [0.5 * r[0], 0.5 * r[1]],
                    }
                } else {
                    let mut scl = rep;
                    if dataid >= 0 {
                        for k in 0..2 {
                            scl[k] /= s[k]
                        }
                    }
                    if uni {
                        for k in 0..2 {
                            scl[k] *= s[k]
                        }
                    }
                    Mapping::Flat {
                        texture: slot,
                        scale: [0.5 * scl[0], -0.5 * scl[1]],
                        offset: [-0.5, -0.5],
                    }
                }
            } else {
                Mapping::Cube { texture: slot, scale: if uni { s } else { [1.0; 3] } }
            }
        });
        let c = &g["rgba"];
        let material = Material {
            color: [0, 1, 2, 3].map(|k| c[k].as_f64().unwrap() as f32),
            emission: g["emission"].as_f64().unwrap() as f32,
            specular: g["specular"].as_f64().unwrap() as f32,
            shininess: 128.0 * g["shininess"].as_f64().unwrap() as f32,
            reflectance: g["reflectance"].as_f64().unwrap() as f32,
            texture,
        };
        instances.push(Instance {
            shape,
            position: f3(&g["pos"]),
            rotation,
            material,
            segment: g["segid"].as_i64().unwrap() as i32,
            casts_shadow: g["category"] != 4,
        });
    }
    let scene = Scene { camera, lights, instances, sky, haze: None };
    let var = std::env::var("V").unwrap_or_default();
    let quality = Quality {
        antialias: std::env::var("NOAA").is_err(),
        shadows: !(var == "noshadow" || var == "plain"),
        reflections: !(var == "noreflect" || var == "plain"),
    };
    let mut r = SceneRenderer::new(Geometry::new(size, size), quality).unwrap();
    let mut frame = vec![0; size * size * 3];
    r.render(&scene, &assets, &mut frame).unwrap();
    if reps > 0 {
        let mut best = f64::MAX;
        for _ in 0..5 {
            let t = cpu();
            for _ in 0..reps {
                r.render(&scene, &assets, &mut frame).unwrap();
            }
            best = best.min((cpu() - t) / reps as f64);
        }
        println!("{name} {size}: {:.3} ms, {:.0} fps", best * 1e3, 1.0 / best);
    }
    let out = format!("/tmp/r3d/out/{name}_{size}{}{}.png", if var.is_empty() { "" } else { "_" }, var);
    std::fs::create_dir_all(Path::new(&out).parent().unwrap()).unwrap();
    let mut e = png::Encoder::new(std::fs::File::create(out).unwrap(), size as u32, size as u32);
    e.set_color(png::ColorType::Rgb);
    e.set_depth(png::BitDepth::Eight);
    e.write_header().unwrap().write_image_data(&frame).unwrap();
}

fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/self/schedstat").unwrap();
    s.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9
}

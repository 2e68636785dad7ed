use satgs::frame::*;
use satgs::scene::*;
use satgs::splat::recipe::Recipe;
use satgs::splat::*;
fn main() {
    let d = std::path::PathBuf::from("/work/shared/data/jax068");
    let which = std::env::args().nth(1).unwrap();
    let out = std::env::args().nth(2).unwrap();
    let iters: u32 = std::env::args().nth(3).unwrap().parse().unwrap();
    let scene = read(&d, &ReadOptions { rpcs: Some("rpcs_ba_v2".into()), suns: vec![] }).unwrap();
    let text = std::fs::read_to_string("/tmp/pts.txt").unwrap();
    let pts: Vec<Point<Geodetic>> = text
        .lines()
        .map(|l| {
            let v: Vec<f64> = l.split_whitespace().map(|x| x.parse().unwrap()).collect();
            Point::new(v[0], v[1], v[2])
        })
        .collect();
    let rpcs: Vec<_> = scene.views.iter().map(|v| v.rpc.clone()).collect();
    let setup = setup::Setup::new(&scene, &rpcs, &pts).unwrap();
    eprintln!("{:?} {:?} half {}", setup.area, setup.altitudes, setup.half_side_m());
    for v in &setup.views {
        eprintln!("{} {:.3} {:.3} {:?}", v.name, v.rms_px, v.max_px, v.sun_shear);
    }
    let views = setup.training_views(&scene).unwrap();
    let n = views.len();
    let mut recipe = Recipe::named(&which).unwrap();
    if let Ok(t) = std::env::var("PATCH") {
        let mut j = serde_json::to_value(&recipe).unwrap();
        let p: serde_json::Value = serde_json::from_str(&t).unwrap();
        merge(&mut j, p);
        recipe = serde_json::from_value(j).unwrap();
    }
    let recipe = recipe.with_iterations(iters);
    let start = init::start(&setup.sparse(&pts), setup.area, recipe.carpet, 0);
    eprintln!("start {}", start.len());
    let mut b = cpu::CpuBackend::new(start, views, setup.altitudes);
    let t = std::time::Instant::now();
    let (made, log) = train::train(&mut b, &recipe, n, setup.half_side_m(), 0, &|e| {
        if let satgs::event::Event::Advanced { done, status } = e {
            if done % 200 == 0 {
                eprintln!("{done} {status} {:.1}s", t.elapsed().as_secs_f64());
            }
        }
    });
    let l = log.last().unwrap();
    eprintln!("{l:?}");
    let (w, s, e, nn) = setup.area;
    let [x, y, _] = setup.site.origin.xyz();
    let grid = satgs::raster::MapGrid::covering(setup.site.epsg, (x + w, y + s, x + e, y + nn), 0.5);
    let app = made.appearances[setup.reference_among_training()];
    let surf = satgs::dsm::render(&made.splats, &setup.site, grid, &app);
    let out = std::path::Path::new(&out);
    surf.write_dsm(&out.join("dsm.tif")).unwrap();
    surf.write_ortho(&out.join("ortho.tif")).unwrap();
    satgs::raster::write_png_gray(
        &out.join("hillshade.png"),
        grid.width,
        grid.height,
        &satgs::dsm::hillshade(&surf.height, 0.5),
    )
    .unwrap();
    ply::write(&out.join("splats.ply"), &made.splats, &setup.site).unwrap();
}
fn merge(a: &mut serde_json::Value, b: serde_json::Value) {
    if let (Some(x), serde_json::Value::Object(y)) = (a.as_object_mut(), b.clone()) {
        for (k, v) in y {
            merge(x.entry(k).or_insert(serde_json::Value::Null), v);
        }
    } else {
        *a = b;
    }
}

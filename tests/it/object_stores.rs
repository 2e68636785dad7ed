//! Scenes on web servers, in object stores and in archives, and images of which no part can be read by itself.
use crate::common::web_server::{Folders, WebServer};
use crate::common::{camera, image, resampled, satgs, two_views};
use gdal::raster::{Buffer, RasterCreationOptions};
use satgs::frame::Pixel;
use satgs::io::{Window, vsi};
use satgs::rpc::formats::to_rpb;
use satgs::scene::{Aoi, ReadOptions, Scene, SceneError, View, read, require_tiled_images};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Output;

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).replace('\n', " ")
}

fn read_scene(path: impl AsRef<Path>) -> Result<Scene, SceneError> {
    read(path.as_ref(), &ReadOptions::default())
}

/// The small town's images and one RPC file of each kind, in a folder; and a list of them whose paths begin with `place`.
struct Town(tempfile::TempDir);

const VIEWS: [&str; 3] = ["VIEW_01", "VIEW_02", "VIEW_03"];

impl Town {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let town = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/town");
        for (view, rpc) in VIEWS.iter().zip(["_RPC.TXT", ".RPB", "_RPC.json"]) {
            let (from, to) = (town.join(format!("{view}.tif")), folder.path().join(format!("{view}.tif")));
            std::fs::copy(&from, &to).unwrap();
            let rpc = folder.path().join(format!("{view}{rpc}"));
            let made = satgs(&["rpc", "convert", to.to_str().unwrap(), rpc.to_str().unwrap()]);
            assert!(made.status.success(), "{}", stderr(&made));
        }
        Self(folder)
    }

    fn list(&self, name: &str, place: impl Fn(&str) -> String) -> PathBuf {
        let views =
            VIEWS.map(|v| format!("[[view]]\nimage = \"{}\"\nname = \"{v}\"\n", place(&format!("{v}.tif"))));
        let list = self.0.path().join(name);
        std::fs::write(&list, views.join("\n")).unwrap();
        list
    }
}

/// Every command that reads images, on the same list with local and remote paths.
#[test]
fn a_run_of_images_on_a_web_server_gives_the_bytes_of_local_ones() {
    let town = Town::new();
    let server = WebServer::of(town.0.path(), Folders::Hidden);
    let lists = [town.list("local.toml", str::to_owned), town.list("remote.toml", |file| server.path(file))];
    let runs = lists.each_ref().map(|list| {
        let run = list.with_extension("run");
        let (list, out) = (list.to_str().unwrap(), run.to_str().unwrap());
        let info = satgs(&["info", list, "--json"]);
        assert!(info.status.success(), "{}", stderr(&info));
        let made = satgs(&["run", list, "-o", out, "--iterations", "40", "--seed", "1"]);
        assert!(made.status.success(), "{}", stderr(&made));
        let again = satgs(&["run", list, "-o", out, "--iterations", "40", "--seed", "1"]);
        assert!(again.status.success() && !stderr(&again).contains("changed"), "{}", stderr(&again));
        run
    });
    for file in ["splats.ply", "dsm.tif", "ortho.tif", "ba/tie_points.csv"] {
        let [local, remote] = runs.each_ref().map(|run| std::fs::read(run.join(file)).unwrap());
        assert!(local == remote, "{file}");
    }
    println!("{} requests, {} bytes", server.requests().len(), server.sent());
}

#[test]
fn a_run_is_told_that_an_image_on_the_server_is_another() {
    let town = Town::new();
    let server = WebServer::of(town.0.path(), Folders::Hidden);
    let list = town.list("remote.toml", |file| server.path(file));
    let (list, run) = (list.to_str().unwrap(), town.0.path().join("run"));
    let adjust = || satgs(&["ba", list, "-o", run.to_str().unwrap()]);
    assert!(adjust().status.success());
    // A byte at the end of the file belongs to no pixel.
    let image = town.0.path().join("VIEW_02.tif");
    let mut bytes = std::fs::read(&image).unwrap();
    bytes.push(0);
    std::fs::write(&image, bytes).unwrap();
    let refused = stderr(&adjust());
    assert!(refused.contains("image VIEW_02 has changed"), "{refused}");
}

#[test]
fn rpc_files_beside_remote_images_are_found_whether_the_folder_is_listed_or_not() {
    let town = Town::new();
    let above = tempfile::tempdir().unwrap();
    let folder = above.path().join("town");
    std::fs::create_dir(&folder).unwrap();
    for entry in std::fs::read_dir(town.0.path()).unwrap() {
        let file = entry.unwrap().path();
        std::fs::copy(&file, folder.join(file.file_name().unwrap())).unwrap();
    }
    for folders in [Folders::Hidden, Folders::Listed] {
        let server = WebServer::of(above.path(), folders);
        let scene = read_scene(town.list("remote.toml", |file| server.url(&format!("town/{file}")))).unwrap();
        let found: Vec<&str> = scene.views.iter().map(|v| v.rpc_source.as_str()).collect();
        assert_eq!(found, ["VIEW_01_RPC.TXT", "VIEW_02.RPB", "VIEW_03_RPC.json"]);
        if folders == Folders::Listed {
            // The folder itself is a scene then.
            assert_eq!(read_scene(server.path("town")).unwrap().views.len(), 3);
        }
    }
}

#[test]
fn urls_in_a_stac_item_are_read_where_they_are() {
    let town = Town::new();
    let server = WebServer::of(town.0.path(), Folders::Hidden);
    let item = |href: &str| {
        format!(
            r#"{{"type": "Feature", "id": "one", "properties": {{"datetime": "2020-06-21T11:00:00Z"}},
            "assets": {{"analytic": {{"href": "{href}", "roles": ["data"]}},
            "rpc": {{"href": "./VIEW_01_RPC.TXT", "roles": ["rpc"]}}}}}}"#
        )
    };
    // The item itself may be remote; what is relative in it is relative to it.
    std::fs::write(town.0.path().join("item.json"), item(&server.url("VIEW_01.tif"))).unwrap();
    let scene = read_scene(server.url("item.json")).unwrap();
    assert_eq!(scene.views[0].image.to_str().unwrap(), server.path("VIEW_01.tif"));
    assert_eq!(scene.views[0].rpc_source, "VIEW_01_RPC.TXT");
    let relative = town.0.path().join("relative.json");
    std::fs::write(&relative, item("./VIEW_01.tif")).unwrap();
    assert_eq!(read_scene(server.url("relative.json")).unwrap().views[0].width, scene.views[0].width);
    std::fs::write(&relative, item("gopher://host/a.tif")).unwrap();
    let refused = read_scene(&relative).unwrap_err().to_string();
    assert!(refused.contains("URLs of `gopher` cannot be read"), "{refused}");
}

#[test]
fn what_cannot_be_read_is_named_with_the_words_of_gdal() {
    let town = Town::new();
    let server = WebServer::of(town.0.path(), Folders::Hidden);
    let refusal = |place: &dyn Fn(&str) -> String| {
        let list = town.list("list.toml", place);
        let refused = satgs(&["info", list.to_str().unwrap()]);
        assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
        stderr(&refused)
    };
    let absent = refusal(&|file| server.path(&format!("no/{file}")));
    assert!(absent.contains("no/VIEW_01.tif") && absent.contains("404"), "{absent}");
    // Nothing listens on port 9.
    let silent = refusal(&|file| format!("/vsicurl/http://127.0.0.1:9/{file}"));
    assert!(silent.contains("127.0.0.1:9/VIEW_01.tif") && silent.contains("connect"), "{silent}");
    let gone = satgs(&["info", &server.path("list-of-another-town.toml")]);
    assert!(stderr(&gone).contains("404"), "{}", stderr(&gone));
}

#[test]
fn a_window_of_a_remote_image_costs_few_bytes() {
    const SIDE: usize = 4096;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.tif");
    let options = RasterCreationOptions::from_iter(["TILED=YES"]);
    let driver = gdal::DriverManager::get_driver_by_name("GTiff").unwrap();
    let dataset = driver.create_with_band_type_with_options::<u8, _>(&path, SIDE, SIDE, 1, &options).unwrap();
    let pixels: Vec<u8> = (0..SIDE * SIDE).map(|i| (i % 251) as u8).collect();
    dataset
        .rasterband(1)
        .unwrap()
        .write((0, 0), (SIDE, SIDE), &mut Buffer::new((SIDE, SIDE), pixels))
        .unwrap();
    dataset.close().unwrap();
    let rpc = resampled(&camera(5.44, 0.0), SIDE as f64 / 64.0);
    std::fs::write(folder.path().join("large.rpb"), to_rpb(&rpc)).unwrap();
    let list = |name: &str, image: &str| {
        let list = folder.path().join(name);
        std::fs::write(&list, format!("[[view]]\nimage = \"{image}\"\n")).unwrap();
        list
    };
    let place = |col, row| rpc.localize(Pixel::new(col, row), 100.0).unwrap();
    let (nw, se) = (place(2000.0, 1500.0), place(2200.0, 1700.0));
    let aoi = Aoi::from_box([nw.lon_deg(), se.lat_deg(), se.lon_deg(), nw.lat_deg()]).unwrap();
    let options = ReadOptions { aoi: Some(aoi), height_range: Some((99.0, 101.0)), ..Default::default() };
    let server = WebServer::of(folder.path(), Folders::Hidden);
    let remote = read(&list("remote.toml", &server.path("large.tif")), &options).unwrap();
    let local = read(&list("local.toml", "large.tif"), &options).unwrap();
    assert_eq!(remote.views[0].read_colors().unwrap(), local.views[0].read_colors().unwrap());
    let (sent, all) = (server.sent(), (SIDE * SIDE) as u64);
    println!("{sent} of {all} bytes in {} requests", server.requests().len());
    assert!(sent < all / 10, "{sent} of {all} bytes");
    let cost = remote.views[0].read_cost(remote.views[0].window.unwrap()).unwrap();
    assert!(cost.block_bytes < all / 10 && cost.stored_bytes <= cost.block_bytes, "{cost:?}");
    // What a file is, is told from its first bytes; so is the difference of two files of one size from samples.
    let before = server.sent();
    let path = PathBuf::from(server.path("large.tif"));
    assert_eq!(vsi::identity(&path).unwrap(), vsi::identity(&path).unwrap());
    vsi::content_hash(&path).unwrap();
    assert!(server.sent() - before < 16 * 16_384, "{}", server.sent() - before);
}

/// A view of an image of 40,000² pixels, which is empty on disk; with strips of whole rows unless `tiled`.
fn giant(folder: &Path, tiled: bool) -> View {
    const SIDE: usize = 40_000;
    let path = folder.join(if tiled { "tiled.tif" } else { "striped.tif" });
    let mut options = vec!["SPARSE_OK=TRUE", "BIGTIFF=YES"];
    options.extend(tiled.then_some("TILED=YES"));
    let driver = gdal::DriverManager::get_driver_by_name("GTiff").unwrap();
    let options = RasterCreationOptions::from_iter(options);
    driver
        .create_with_band_type_with_options::<u16, _>(&path, SIDE, SIDE, 1, &options)
        .unwrap()
        .close()
        .unwrap();
    let rpc = resampled(&camera(5.44, 0.0), SIDE as f64 / 64.0);
    std::fs::write(path.with_extension("rpb"), to_rpb(&rpc)).unwrap();
    let list = folder.join("giant.toml");
    std::fs::write(&list, format!("[[view]]\nimage = \"{}\"\n", path.display())).unwrap();
    read_scene(&list).unwrap().views.remove(0)
}

#[test]
fn a_striped_giant_of_which_windows_are_needed_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let (striped, tiled) = (giant(folder.path(), false), giant(folder.path(), true));
    assert!(std::fs::metadata(&striped.image).unwrap().len() < 2_000_000, "it is sparse");
    let window = |i: usize| Window { col: 2400 * i, row: 2400 * i, width: 2400, height: 2400 };
    let cost = striped.read_cost(window(3)).unwrap();
    assert_eq!((cost.window_bytes, cost.block_bytes), (2 * 2400 * 2400, 2 * 2400 * 40_000));
    assert!(tiled.read_cost(window(3)).unwrap().block_bytes < 3 * 2 * 2400 * 2400 / 2);
    // One window is little; those of a plan of tiles are not.
    let reads = |view, n| (0..n).map(move |i| (view, window(i)));
    assert!(require_tiled_images(reads(&striped, 1)).is_ok());
    assert!(require_tiled_images(reads(&tiled, 16)).is_ok());
    let whole = Window { col: 0, row: 0, width: 40_000, height: 40_000 };
    assert!(require_tiled_images([(&striped, whole)]).is_ok(), "all of it is needed");
    let refused = require_tiled_images(reads(&striped, 16)).unwrap_err();
    let (text, help) = (refused.to_string(), miette::Diagnostic::help(&refused).unwrap().to_string());
    assert!(text.contains("striped.tif` is stored as strips of whole rows"), "{text}");
    assert!(help.contains("gdal_translate -of COG IN OUT"), "{help}");
    // So is a part of it that an area of interest crops.
    let place = |col, row| striped.rpc.localize(Pixel::new(col, row), 100.0).unwrap();
    let (nw, se) = (place(10_000.0, 5_000.0), place(13_500.0, 33_000.0));
    let aoi = Aoi::from_box([nw.lon_deg(), se.lat_deg(), se.lon_deg(), nw.lat_deg()]).unwrap();
    let options = ReadOptions { aoi: Some(aoi), height_range: Some((99.0, 101.0)), ..Default::default() };
    let list = folder.path().join("list.toml");
    for (view, is_refused) in [(&striped, true), (&tiled, false)] {
        std::fs::write(&list, format!("[[view]]\nimage = \"{}\"\n", view.image.display())).unwrap();
        let cropped = read(&list, &options);
        assert_eq!(
            matches!(cropped, Err(SceneError::Striped { .. })),
            is_refused,
            "{:?}",
            cropped.map(|s| s.views)
        );
    }
}

/// An archive of tar, which holds files as they are after a header of 512 bytes each.
fn tar(folder: &Path, names: &[&str]) -> Vec<u8> {
    let mut out = Vec::new();
    for name in names {
        let content = std::fs::read(folder.join(name)).unwrap();
        let mut head = [0_u8; 512];
        head[..name.len()].copy_from_slice(name.as_bytes());
        head[100..108].copy_from_slice(b"0000644\0");
        head[124..136].copy_from_slice(format!("{:011o}\0", content.len()).as_bytes());
        head[136..148].copy_from_slice(b"00000000000\0");
        head[148..156].copy_from_slice(b"        ");
        head[156] = b'0';
        head[257..265].copy_from_slice(b"ustar\x0000");
        let sum: u32 = head.iter().map(|b| u32::from(*b)).sum();
        head[148..156].copy_from_slice(format!("{sum:06o}\0 ").as_bytes());
        out.extend(head);
        out.extend(&content);
        out.resize(out.len().next_multiple_of(512), 0);
    }
    out.resize(out.len() + 1024, 0);
    out
}

#[test]
fn a_folder_in_an_archive_is_a_scene() {
    let folder = two_views();
    image(&folder.path().join("c.tif"), 3, None, &[]);
    std::fs::write(folder.path().join("c.rpb"), to_rpb(&camera(5.44, 0.1))).unwrap();
    let archive = folder.path().join("scene.tar");
    std::fs::write(&archive, tar(folder.path(), &["a.tif", "b.tif", "c.tif", "c.rpb"])).unwrap();
    let inside = format!("/vsitar/{}", archive.display());
    let (packed, plain) = (read_scene(&inside).unwrap(), read_scene(folder.path()).unwrap());
    assert_eq!(packed.views.len(), 3);
    for (packed, plain) in packed.views.iter().zip(&plain.views) {
        assert_eq!(
            (&packed.name, &packed.rpc, &packed.rpc_source),
            (&plain.name, &plain.rpc, &plain.rpc_source)
        );
        assert_eq!(packed.read_colors().unwrap(), plain.read_colors().unwrap());
    }
}

/// A server that speaks the protocol of S3: the program `moto_server` (of the Python package `moto[server]`). It ends with
/// this value.
struct Moto(std::process::Child, u16);

impl Moto {
    /// Starts it; says so and returns `None` where it is not installed.
    fn start() -> Option<Self> {
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut command = std::process::Command::new("moto_server");
        command.args(["-H", "127.0.0.1", "-p", &port.to_string()]);
        command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
        let Ok(child) = command.spawn() else {
            println!("skipped: `moto_server` is not installed (pip install 'moto[server]')");
            return None;
        };
        let moto = Self(child, port);
        for _ in 0..600 {
            if TcpStream::connect(("127.0.0.1", port)).is_ok() {
                return Some(moto);
            }
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        panic!("moto_server does not answer");
    }

    /// Makes a bucket, or an object in it.
    fn put(&self, key: &str, content: &[u8]) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.1)).unwrap();
        let head = format!(
            "PUT /{key} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            content.len()
        );
        stream.write_all(&[head.as_bytes(), content].concat()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }
}

impl Drop for Moto {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_prefix_of_a_bucket_is_a_folder_of_images() {
    let Some(moto) = Moto::start() else { return };
    let town = Town::new();
    moto.put("imagery", &[]);
    for entry in std::fs::read_dir(town.0.path()).unwrap() {
        let file = entry.unwrap().path();
        let name = file.file_name().unwrap().to_string_lossy();
        moto.put(&format!("imagery/town/{name}"), &std::fs::read(&file).unwrap());
    }
    let list = town.list("s3.toml", |file| format!("s3://imagery/town/{file}"));
    let info = |scene: &str, key: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_satgs"));
        let endpoint = format!("127.0.0.1:{}", moto.1);
        command.args(["info", scene, "--json"]).env("AWS_S3_ENDPOINT", endpoint).env("HOME", town.0.path());
        command.env("AWS_VIRTUAL_HOSTING", "FALSE").env("AWS_HTTPS", "NO").env("AWS_REGION", "us-east-1");
        command.env("AWS_ACCESS_KEY_ID", key).env("AWS_SECRET_ACCESS_KEY", key).output().unwrap()
    };
    for scene in ["/vsis3/imagery/town", "s3://imagery/town", list.to_str().unwrap()] {
        let found = info(scene, "testing");
        let text = String::from_utf8_lossy(&found.stdout);
        assert!(
            found.status.success() && VIEWS.iter().all(|v| text.contains(v)),
            "{scene}: {}",
            stderr(&found)
        );
    }
    let refused = info("s3://imagery/town", "");
    assert!(stderr(&refused).contains("AWS_SECRET_ACCESS_KEY"), "{}", stderr(&refused));
}

//! `satgs view`: the page of a run, in a browser where there is one, and what is refused.

use crate::common;
use crate::common::satgs;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// How long a page may take until its splats are drawn: without a graphics card, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A small run, made once.
fn run() -> &'static Path {
    static RUN: OnceLock<tempfile::TempDir> = OnceLock::new();
    RUN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let (town, run) = ("data/town", folder.path().to_str().unwrap());
        let made = satgs(&["run", town, "-o", run, "--iterations", "20"]);
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        folder
    })
    .path()
}

/// What a refused command says, and its exit code.
fn refusal(args: &[&str]) -> (String, Option<i32>) {
    let output = satgs(args);
    (String::from_utf8_lossy(&output.stderr).into_owned(), output.status.code())
}

fn chromium() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let found = std::env::split_paths(&path)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|file| file.is_file());
    if found.is_none() {
        println!("skipped: no chromium");
    }
    found
}

/// A browser without a window, spoken to by the Chrome DevTools Protocol through a pair of pipes.
struct Browser {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    session: Value,
    asked: u64,
    /// Errors that the browser reported, and requests of the page that leave this machine.
    complaints: Vec<String>,
    _profile: tempfile::TempDir,
}

impl Browser {
    fn open(program: &Path, url: &str) -> Self {
        let profile = tempfile::tempdir().unwrap();
        // The protocol is spoken on the files 3 and 4.
        let mut process = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 >/dev/null 2>&1"])
            .arg(program)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .args(["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
            .args(["--window-size=900,600", "--remote-debugging-pipe"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, from) = (process.stdin.take().unwrap(), BufReader::new(process.stdout.take().unwrap()));
        let session = Value::Null;
        let mut browser =
            Self { process, to, from, session, asked: 0, complaints: vec![], _profile: profile };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let id = &target["targetId"];
        let attached = browser.call("Target.attachToTarget", json!({ "targetId": id, "flatten": true }));
        browser.session = attached["sessionId"].clone();
        for domain in ["Runtime", "Log", "Network", "Page"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser.call("Page.navigate", json!({ "url": url }));
        browser
    }

    /// The result of a call; what the browser tells meanwhile is looked through.
    fn call(&mut self, method: &str, params: Value) -> Value {
        self.asked += 1;
        let mut message = json!({ "id": self.asked, "method": method, "params": params });
        if !self.session.is_null() {
            message["sessionId"] = self.session.clone();
        }
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let mut bytes = Vec::new();
            self.from.read_until(0, &mut bytes).unwrap();
            assert!(bytes.pop().is_some(), "the browser has ended");
            let answer: Value = serde_json::from_slice(&bytes).unwrap();
            if answer["id"] == self.asked {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
            self.look_at(&answer);
        }
    }

    fn look_at(&mut self, event: &Value) {
        let (params, url) = (&event["params"], &event["params"]["request"]["url"]);
        let is_local =
            |url: &str| ["file:", "data:", "blob:", "http://127.0.0.1:"].iter().any(|s| url.starts_with(s));
        let is_complaint = match event["method"].as_str().unwrap_or_default() {
            "Runtime.exceptionThrown" => true,
            "Runtime.consoleAPICalled" => params["type"] == "error",
            "Log.entryAdded" => params["entry"]["level"] == "error",
            "Network.requestWillBeSent" => !url.as_str().is_some_and(is_local),
            _ => false,
        };
        if is_complaint {
            self.complaints.push(event.to_string());
        }
    }

    fn value(&mut self, expression: &str) -> Value {
        let found = self.call("Runtime.evaluate", json!({ "expression": expression, "returnByValue": true }));
        found["result"]["value"].clone()
    }

    /// Waits until an expression has this value.
    fn wait_for(&mut self, expression: &str, expected: &str) {
        let began = Instant::now();
        loop {
            let found = self.value(expression);
            if found == expected {
                return;
            }
            assert!(began.elapsed() < PATIENCE, "{expression} is {found}: {:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// What the page says of the place under the pointer, once it names this layer.
    fn place_at(&mut self, x: f64, y: f64, layer: &str) -> String {
        self.value("$('place').replaceChildren()");
        self.call("Input.dispatchMouseEvent", json!({ "type": "mouseMoved", "x": x, "y": y }));
        let began = Instant::now();
        loop {
            let text = self.value("$('place').innerText");
            let text = text.as_str().unwrap().replace('\u{2212}', "-");
            if text.contains(layer) {
                return text;
            }
            assert!(began.elapsed() < PATIENCE, "{layer} is not shown: {text}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// The data attributes of the page's root element, once its splats are drawn.
    fn drawn(&mut self) -> Value {
        let began = Instant::now();
        loop {
            let data = self.value("({ ...document.documentElement.dataset })");
            if data["state"] == "drawn" || !data["failures"].is_null() {
                return data;
            }
            assert!(began.elapsed() < PATIENCE, "nothing was drawn: {data}, {:?}", self.complaints);
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn a_page_in_one_file_draws_the_splats_and_reads_the_heights_of_the_surface() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let html = folder.path().join("town.html");
    let made = satgs(&["view", run().to_str().unwrap(), "--html", html.to_str().unwrap(), "--json"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let summary: Value = serde_json::from_slice(&made.stdout).unwrap();
    assert_eq!(summary["layers"], json!(["Splats", "DSM", "Sparse points", "Cameras"]));
    assert_eq!(summary["bytes"], std::fs::metadata(&html).unwrap().len());

    let mut browser = Browser::open(&chromium, &format!("file://{}", html.display()));
    let data = browser.drawn();
    assert!(data["failures"].is_null(), "{data}");
    assert!(data["splats"].as_str().unwrap().parse::<u32>().unwrap() > 1000, "{data}");
    // The area fills about a fifth of the window.
    let share: f64 = data["coverage"].as_str().unwrap().parse().unwrap();
    assert!(share > 0.05 && share < 0.5, "{data}");

    let dsm = satgs::io::ImageFile::open(&run().join("dsm.tif")).unwrap();
    let (grid, heights) = (dsm.map_grid().unwrap(), dsm.read(1).unwrap());
    let surface = |easting: f64, northing: f64| {
        let at = grid.corner_px_from_utm(satgs::frame::Point::new(easting, northing, 0.0));
        f64::from(heights.bilinear(at.col - 0.5, at.row - 0.5))
    };
    let place = browser.place_at(430.0, 310.0, "Splats");
    let [easting, northing, height] = numbers(&place)[..3] else { panic!("{place}") };
    let beside = place.split("DSM ").nth(1).unwrap().split(' ').next().unwrap().parse::<f64>().unwrap();
    assert!(place.contains("EPSG:32631"), "{place}");
    assert!((beside - surface(easting, northing)).abs() < 0.3, "{place}: {}", surface(easting, northing));
    assert!((height - beside).abs() < 2.0, "splats far from the surface model: {place}");

    browser.value("['splats', 'relief'].forEach((kind) => document.querySelector(`[name=${kind}]`).click())");
    let place = browser.place_at(431.0, 311.0, "DSM, EPSG");
    let [easting, northing, height] = numbers(&place)[..3] else { panic!("{place}") };
    let expected = surface(easting, northing);
    assert!((height - expected).abs() < 0.3, "{height} where the surface model has {expected}");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// The numbers of a text.
fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().filter_map(|word| word.parse().ok()).collect()
}

#[test]
fn two_clicks_give_a_profile_of_splats_and_surface_model() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let html = folder.path().join("town.html");
    satgs::pipeline::write_page(run(), None, &html, false).unwrap();
    let mut browser = Browser::open(&chromium, &format!("file://{}", html.display()));
    browser.drawn();
    for [x, y] in [[400.0, 280.0], [500.0, 330.0]] {
        for kind in ["mousePressed", "mouseReleased"] {
            let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "clickCount": 1 });
            browser.call("Input.dispatchMouseEvent", event);
        }
    }
    let table = browser.value("profileTable(profile)");
    let mut lines = table.as_str().unwrap().lines();
    assert_eq!(lines.next(), Some("distance_m,easting_m,northing_m,splats_m,dsm_m"));
    let rows: Vec<Vec<Option<f64>>> =
        lines.map(|line| line.split(',').map(|v| v.parse().ok()).collect()).collect();
    assert_eq!(rows.len(), 240);
    let level = browser.value("$('level').textContent");
    let level: f64 = level.as_str().unwrap().trim_end_matches(" m").parse().unwrap();
    assert!((rows[239][0].unwrap() - level).abs() < 0.01, "{level} {:?}", rows[239]);
    let mut off: Vec<f64> = rows.iter().filter_map(|row| Some((row[3]? - row[4]?).abs())).collect();
    off.sort_by(f64::total_cmp);
    assert!(off.len() > 150 && off[off.len() / 2] < 1.0, "{} {:?}", off.len(), off.get(off.len() / 2));

    browser.value("document.querySelector('[name=tint][value=height]').click()");
    let legend = browser.value("$('heights').textContent");
    assert!(legend.as_str().is_some_and(|text| text.matches(" m").count() == 2), "{legend}");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn photographs_and_splats_without_a_map_are_shown_upright() {
    let folder = tempfile::tempdir().unwrap();
    common::photographs::make_run(folder.path());
    let (run, html) = (folder.path().join("run"), folder.path().join("ball.html"));
    let page = satgs::pipeline::write_page(&run, None, &html, false).unwrap();
    assert_eq!(page.layers, ["Splats", "Sparse points", "Cameras"]);
    let Some(chromium) = chromium() else { return };
    let mut browser = Browser::open(&chromium, &format!("file://{}", html.display()));
    let data = browser.drawn();
    assert!(data["failures"].is_null() && browser.complaints.is_empty(), "{data} {:?}", browser.complaints);
    // Up is minus y in this scene, and z on the page.
    let up = browser.value("turned([0, -1, 0]).z");
    assert!(up.as_f64().unwrap() > 0.9, "{up}");
}

#[test]
fn a_served_page_draws_the_splats() {
    let mut server = Command::new(env!("CARGO_BIN_EXE_satgs"))
        .args(["view", run().to_str().unwrap(), "--no-open"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let url = line.split_whitespace().next().unwrap().to_owned();
    let address = url.trim_start_matches("http://").trim_end_matches('/');
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(format!("GET /splats-0.ply HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let answer = String::from_utf8_lossy(&answer[..2000]).into_owned();
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("property float f_dc_0"), "{answer}");
    if let Some(chromium) = chromium() {
        let mut browser = Browser::open(&chromium, &url);
        let data = browser.drawn();
        assert!(
            data["failures"].is_null() && browser.complaints.is_empty(),
            "{data} {:?}",
            browser.complaints
        );
    }
    server.kill().unwrap();
    server.wait().unwrap();
}

#[test]
fn two_runs_are_compared_by_a_divider() {
    let folder = tempfile::tempdir().unwrap();
    let html = folder.path().join("both.html");
    satgs::pipeline::write_page(run(), Some(run()), &html, false).unwrap();
    let Some(chromium) = chromium() else { return };
    let mut browser = Browser::open(&chromium, &format!("file://{}", html.display()));
    browser.drawn();
    browser.wait_for("document.documentElement.dataset.other", "splats relief");
    let ours = browser.place_at(400.0, 310.0, "Splats");
    let theirs = browser.place_at(500.0, 310.0, "Splats of ");
    assert!(!ours.contains("Splats of ") && theirs.contains("DSM "), "{ours}, {theirs}");
    // With the divider farther to the right, the same place is of the first run.
    browser.value("moveDivider(0.8)");
    let moved = browser.place_at(501.0, 310.0, "Splats");
    assert!(!moved.contains("Splats of "), "{moved}");
    assert!((numbers(&moved)[0] - numbers(&theirs)[0]).abs() < 2.0, "{theirs}, {moved}");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

#[test]
fn a_training_is_watched_from_the_first_checkpoint_to_its_results() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_str().unwrap();
    let satgs = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_satgs"));
        command.args(args).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap()
    };
    let mut training =
        satgs(&["run", "data/town", "-o", path, "--iterations", "300", "--checkpoint-every", "20"]);
    let mut server = satgs(&["view", path, "--live", "--no-open"]);
    let mut line = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let url = line.split_whitespace().next().unwrap().to_owned();
    let address = url.trim_start_matches("http://").trim_end_matches('/').to_owned();
    let seen = || {
        let mut stream = TcpStream::connect(&address).unwrap();
        stream.write_all(format!("GET /run.json HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        serde_json::from_str::<Value>(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap()
    };
    let first = seen();
    assert_eq!(first["live"]["iterations"], 300, "{}", first["live"]);
    assert_eq!(first["layers"][0]["kind"], "splats");
    let mut browser = chromium().map(|chromium| Browser::open(&chromium, &url));
    assert!(training.wait().unwrap().success());
    let began = Instant::now();
    while seen()["layers"].as_array().unwrap().iter().all(|layer| layer["kind"] != "relief") {
        assert!(began.elapsed() < PATIENCE, "{}", seen());
        std::thread::sleep(Duration::from_millis(100));
    }
    if let Some(browser) = &mut browser {
        browser.drawn();
        browser.wait_for("document.documentElement.dataset.training", "Training is complete");
        browser.wait_for("String(layers.some((l) => l.kind === 'relief'))", "true");
        assert!(browser.value("document.documentElement.dataset.failures").is_null());
    }
    server.kill().unwrap();
    server.wait().unwrap();
}

#[test]
fn what_cannot_be_shown_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (run, page) = (run().to_str().unwrap(), path("page.html"));
    std::fs::write(&page, "old").unwrap();
    std::fs::create_dir_all(folder.path().join("tiled/tiles/3_4")).unwrap();
    std::fs::write(folder.path().join("tiled/tiles.json"), "{}").unwrap();
    std::fs::write(folder.path().join("tiled/tiles/3_4/splats.ply"), "").unwrap();
    std::fs::create_dir(folder.path().join("cut")).unwrap();
    std::fs::write(folder.path().join("cut/splats.ply"), "ply\n").unwrap();
    std::fs::copy(format!("{run}/cameras.json"), folder.path().join("cut/cameras.json")).unwrap();
    let taken = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let new = path("new.html");
    for (args, says) in [
        (vec!["view", &path("nowhere"), "--no-open"], "holds no splats"),
        (vec!["view", folder.path().to_str().unwrap(), "--html", &new], "satgs train RUN"),
        (vec!["view", &path("tiled"), "--html", &new], "3_4"),
        (vec!["view", &path("cut"), "--html", &new], "not a supported splat file"),
        (vec!["view", run, "--html", &page], "exists"),
        (vec!["view", run, "--html", &path("page.pdf")], ".html"),
        (vec!["view", run, "--port", &port, "--no-open"], &format!("port {port}")),
        (vec!["view", run, "--port", "0"], "1..=65535"),
        (vec!["view", &path("nowhere"), "--live", "--no-open"], "holds no splats"),
        (vec!["view", run, "--live", "--html", &new], "cannot be used with"),
        (vec!["view", run, "--compare", &path("nowhere"), "--html", &new], "holds no splats"),
    ] {
        let (said, code) = refusal(&args);
        assert!(said.contains(says) && code == Some(2), "{args:?}: {code:?} {said}");
    }
    let (said, code) = refusal(&["view", run, "--html", &format!("{page}/in/a/file.html")]);
    assert!(said.contains("is not a folder") && code == Some(1), "{code:?} {said}");
    assert_eq!(std::fs::read_to_string(&page).unwrap(), "old");
    assert!(!Path::new(&new).exists());
    let replaced = satgs(&["view", run, "--html", &page, "--overwrite"]);
    assert!(replaced.status.success() && std::fs::metadata(&page).unwrap().len() > 1_000_000);
}

/// `scripts/build-viewer` records of which files and versions it made the libraries.
#[test]
#[cfg(target_os = "linux")]
fn the_libraries_are_those_that_the_script_made_of_the_locked_versions() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/viewer/page");
    let checked = Command::new("sha256sum")
        .args(["--check", "--strict", "dist/SHA256SUMS"])
        .current_dir(&folder)
        .output()
        .unwrap();
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
    let lock: Value =
        serde_json::from_slice(&std::fs::read(folder.join("package-lock.json")).unwrap()).unwrap();
    let licenses = std::fs::read_to_string(folder.join("dist/LICENSES.txt")).unwrap();
    for library in ["three", "@sparkjsdev/spark"] {
        let locked = &lock["packages"][format!("node_modules/{library}")];
        assert_eq!(locked["license"], "MIT");
        let line = format!("{library} {}", locked["version"].as_str().unwrap());
        assert!(licenses.lines().any(|l| l == line), "{line}");
    }
    let bytes = std::fs::metadata(folder.join("dist/libraries.js.gz")).unwrap().len();
    assert!(bytes < 1_500_000, "{bytes}");
}

//! A web server for tests: it serves a folder on the loopback interface, understands ranges, and counts what it sends.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// What a server does with requests for folders.
#[derive(Clone, Copy, PartialEq)]
pub enum Folders {
    /// It lists them as a page.
    Listed,
    /// It answers that they do not exist.
    Hidden,
}

/// A server; its thread ends with the program.
pub struct WebServer {
    port: u16,
    sent: Arc<AtomicU64>,
    requests: Arc<Mutex<Vec<String>>>,
}

impl WebServer {
    /// Serves the files of a folder.
    pub fn of(folder: &Path, folders: Folders) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let server = Self {
            port: listener.local_addr().unwrap().port(),
            sent: Arc::default(),
            requests: Arc::default(),
        };
        let (root, sent, requests) =
            (folder.to_path_buf(), Arc::clone(&server.sent), Arc::clone(&server.requests));
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                // A client that goes away is no failure of the server.
                let _ = answer(stream, &root, folders, &sent, &requests);
            }
        });
        server
    }

    /// The URL of a file.
    pub fn url(&self, file: &str) -> String {
        format!("http://127.0.0.1:{}/{file}", self.port)
    }

    /// The path by which GDAL reads a file.
    pub fn path(&self, file: &str) -> String {
        format!("/vsicurl/{}", self.url(file))
    }

    /// Bytes of files that were sent so far.
    pub fn sent(&self) -> u64 {
        self.sent.load(Ordering::SeqCst)
    }

    /// Requests so far, such as `GET /a.tif`.
    pub fn requests(&self) -> Vec<String> {
        self.requests.lock().unwrap().clone()
    }
}

/// Answers the one request of a connection.
fn answer(
    mut stream: TcpStream,
    root: &Path,
    folders: Folders,
    sent: &AtomicU64,
    requests: &Mutex<Vec<String>>,
) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream.try_clone()?).lines();
    let first = lines.next().transpose()?.unwrap_or_default();
    let mut words = first.split(' ');
    let (method, target) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let mut range = None;
    for line in lines {
        let line = line?.to_ascii_lowercase();
        if line.is_empty() {
            break;
        }
        range = range.or(line.strip_prefix("range: bytes=").and_then(parse_range));
    }
    requests.lock().unwrap().push(format!("{method} {target}"));
    let (place, _query) = target.split_once('?').unwrap_or((target, ""));
    let path = root.join(place.trim_start_matches('/'));
    let content = if path.is_dir() {
        if folders == Folders::Listed {
            Ok(listing(&path, target))
        } else {
            Err(std::io::ErrorKind::NotFound.into())
        }
    } else {
        std::fs::read(&path)
    };
    let Ok(content) = content else {
        return stream.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    };
    let size = content.len();
    let (status, from, to) = match range {
        Some((from, to)) if from < size => ("206 Partial Content", from, to.min(size - 1) + 1),
        Some(_) => ("416 Range Not Satisfiable", 0, 0),
        None => ("200 OK", 0, size),
    };
    let body = if method == "HEAD" { &[][..] } else { &content[from..to] };
    let mut head = format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\nAccept-Ranges: bytes\r\n", to - from);
    if range.is_some() {
        head += &format!("Content-Range: bytes {from}-{}/{size}\r\n", to.saturating_sub(1));
    }
    head += &format!("ETag: \"{}\"\r\nConnection: close\r\n\r\n", &blake3::hash(&content).to_hex()[..16]);
    sent.fetch_add(body.len() as u64, Ordering::SeqCst);
    stream.write_all(head.as_bytes())?;
    stream.write_all(body)
}

/// First and last byte of a range `FROM-TO`.
fn parse_range(text: &str) -> Option<(usize, usize)> {
    let (from, to) = text.trim().split_once('-')?;
    Some((from.parse().ok()?, if to.is_empty() { usize::MAX - 1 } else { to.parse().ok()? }))
}

/// A page that lists the folder of a URL, as Apache writes it and GDAL understands it.
fn listing(folder: &Path, target: &str) -> Vec<u8> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    let line = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy();
        let slash = if path.is_dir() { "/" } else { "" };
        format!("<a href=\"{name}{slash}\">{name}{slash}</a> 2023-07-17 10:27 70K\n")
    };
    let (lines, title) = (names.iter().map(line).collect::<String>(), target.trim_end_matches('/'));
    let page = format!(
        "<html><head>\n<title>Index of {title}</title>\n</head><body>\n<h1>Index of {title}</h1>\n<pre>\n\
         {lines}</pre></body></html>\n"
    );
    page.into_bytes()
}

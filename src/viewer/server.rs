//! A server of one page for the browser of this machine.

use super::page::{LIBRARIES, PROGRAM};
use super::{ViewerError, ViewerPage};
use crate::progress::{Interrupted, Progress};
use std::borrow::Cow;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::time::Duration;

/// How often it looks whether to stop.
const POLL: Duration = Duration::from_millis(30);
/// How long it waits for a request.
const PATIENCE: Duration = Duration::from_secs(10);
/// Longest head of a request, bytes.
const LONGEST_HEAD: u64 = 16 << 10;

/// An answer without a body.
const NOT_FOUND: &str = "404 Not Found";

/// A listener of the loopback interface, on a port or a free one, and the address of its page.
///
/// # Errors
/// [`ViewerError::Port`].
pub fn bind(port: Option<u16>) -> Result<(TcpListener, String), ViewerError> {
    let taken = |cause| ViewerError::Port { port: port.unwrap_or_default(), cause };
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0))).map_err(taken)?;
    let address = listener.local_addr().map_err(taken)?;
    Ok((listener, format!("http://{address}/")))
}

/// Serves what is the page at the moment to the programs of this machine, until the caller asks to stop. The listener is one of
/// a loopback address.
///
/// # Errors
/// [`Interrupted`].
pub fn serve(
    listener: &TcpListener,
    page: &(dyn Fn() -> Arc<ViewerPage> + Sync),
    progress: &dyn Progress,
) -> Result<(), Interrupted> {
    let address = listener.local_addr().ok();
    // A listener that cannot be polled is only interrupted with the process.
    let _ = listener.set_nonblocking(true);
    std::thread::scope(|threads| {
        loop {
            progress.check()?;
            match listener.accept() {
                Ok((stream, _)) => {
                    threads.spawn(move || {
                        // A browser that has gone away is no error.
                        let _ = answer(stream, &page(), address);
                    });
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(_) => std::thread::sleep(POLL),
            }
        }
    })
}

/// Reads one request and answers it.
fn answer(mut stream: TcpStream, page: &ViewerPage, address: Option<SocketAddr>) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut lines = BufReader::new((&stream).take(LONGEST_HEAD)).lines();
    let request = lines.next().transpose()?.unwrap_or_default();
    let mut host = String::new();
    for line in lines {
        let line = line?;
        if line.is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(':')
            && name.eq_ignore_ascii_case("host")
        {
            host = value.trim().to_owned();
        }
    }
    let mut words = request.split(' ');
    let (method, path) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    // Pages of other sites must not read this one through a name that they let point here.
    let is_local =
        address.is_some_and(|a| host == a.to_string() || host == format!("localhost:{}", a.port()));
    let name = path.strip_prefix('/').unwrap_or(path);
    let name = name.split(['?', '#']).next().unwrap_or_default();
    let found: Result<(&str, Cow<'_, [u8]>), &str> = match (is_local, method, name) {
        (false, ..) => Err("403 Forbidden"),
        (_, "GET" | "HEAD", "") => Ok(("text/html; charset=utf-8", page.index().into_bytes().into())),
        (_, "GET" | "HEAD", "run.json") => Ok(("application/json", page.run().into_bytes().into())),
        (_, "GET" | "HEAD", "page.js") => Ok(("text/javascript; charset=utf-8", PROGRAM.as_bytes().into())),
        (_, "GET" | "HEAD", "libraries.js") => {
            Ok(("text/javascript; charset=utf-8\r\nContent-Encoding: gzip", LIBRARIES.into()))
        }
        (_, "GET" | "HEAD", name) => {
            let content = page.files.iter().find(|f| f.name == name).and_then(|f| f.content.read().ok());
            content.map(|bytes| ("application/octet-stream", bytes)).ok_or(NOT_FOUND)
        }
        _ => Err("405 Method Not Allowed\r\nAllow: GET, HEAD"),
    };
    let (status, kind, body) = match found {
        Ok((kind, body)) => ("200 OK", kind, body),
        Err(status) => (status, "text/plain", Cow::default()),
    };
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nCross-Origin-Resource-Policy: same-origin\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    if method != "HEAD" {
        stream.write_all(&body)?;
    }
    stream.flush()
}

#[cfg(test)]
mod tests {
    use super::super::{PageFile, PageScope};
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::progress::Event;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[derive(Default)]
    struct UntilDone(AtomicBool);

    impl Progress for UntilDone {
        fn event(&self, _: Event) {}
        fn is_cancelled(&self) -> bool {
            self.0.load(Ordering::SeqCst)
        }
    }

    /// The answer to a request, head and body.
    fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }

    #[test]
    fn it_serves_the_page_and_its_files_to_this_machine_alone() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.0, 3_357_611.0, -20.0) };
        let mut page = ViewerPage::new("run".into(), Some(&site), PageScope::of_area((-1.0, -1.0, 1.0, 1.0)));
        page.files.push(PageFile::new("splats.ply", b"ply data".to_vec()));
        let page = Arc::new(page);
        let (listener, _) = bind(None).unwrap();
        let address = listener.local_addr().unwrap();
        let until = UntilDone::default();
        std::thread::scope(|threads| {
            let server = threads.spawn(|| serve(&listener, &|| page.clone(), &until));
            let get = |path: &str, host: &str| {
                ask(address, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n"))
            };
            let here = address.to_string();
            assert!(get("/", &here).contains("<!doctype html>"));
            assert!(get("/", &format!("localhost:{}", address.port())).contains("<!doctype html>"));
            assert!(get("/splats.ply", &here).ends_with("\r\n\r\nply data"));
            assert!(get("/run.json", &here).contains("\"title\":\"run\""));
            assert!(get("/libraries.js", &here).contains("Content-Encoding: gzip"));
            for (path, host, status) in [
                ("/../Cargo.toml", here.as_str(), "404"),
                ("/other.ply", &here, "404"),
                ("/", "example.org", "403"),
                ("/splats.ply", "", "403"),
            ] {
                let got = get(path, host);
                assert!(got.starts_with(&format!("HTTP/1.1 {status}")), "{path} of {host}: {got}");
            }
            let posted = ask(address, &format!("POST / HTTP/1.1\r\nHost: {here}\r\n\r\n"));
            assert!(posted.starts_with("HTTP/1.1 405"), "{posted}");
            let head = ask(address, &format!("HEAD /splats.ply HTTP/1.1\r\nHost: {here}\r\n\r\n"));
            assert!(head.contains("Content-Length: 8") && head.ends_with("\r\n\r\n"), "{head}");
            assert!(ask(address, "\r\n\r\n").starts_with("HTTP/1.1 403"));
            until.0.store(true, Ordering::SeqCst);
            assert!(server.join().unwrap().is_err());
        });
    }
}

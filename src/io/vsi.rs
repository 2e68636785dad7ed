//! Input files by path: local ones, and those of GDAL's virtual file systems (`/vsis3/`, `/vsicurl/`, `/vsizip/`, …).
//!
//! All questions about input files go through this module, so that a scene may lie on a web server, in an object store or
//! in an archive. Nothing is copied: GDAL reads the parts that are needed. Credentials and other options are those of
//! GDAL's environment ([list](https://gdal.org/user/virtual_file_systems.html)).

use super::gdal_vsi::{VsiFile, headers, names_in, prefixes};
use rayon::prelude::*;
use std::io::{Error, Read, Result, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::sync::OnceLock;

/// Parts of paths of file systems that are read over a network.
const NETWORK: [&str; 9] =
    ["/vsicurl", "/vsis3", "/vsigs", "/vsiaz", "/vsiadls", "/vsioss", "/vsiswift", "/vsihdfs", "/vsiwebhdfs"];
/// Beginnings of URLs, and of the paths by which GDAL reads them.
const URLS: [(&str, &str); 7] = [
    ("https://", "/vsicurl/https://"),
    ("http://", "/vsicurl/http://"),
    ("ftp://", "/vsicurl/ftp://"),
    ("s3://", "/vsis3/"),
    ("gs://", "/vsigs/"),
    ("az://", "/vsiaz/"),
    ("file://", ""),
];
/// Largest number of files of a remote folder that is listed; in a larger one single names are tried.
const MOST_NAMES: i32 = 10_000;
/// Suffixes of the files beside an image that GDAL reads with it.
const OF_GDAL: [&str; 3] = [".aux.xml", ".msk", ".ovr"];
/// Number of bytes in a sample of a remote file, which is the size of GDAL's smallest request, and number of samples.
const SAMPLE: u64 = 16_384;
const SAMPLES: u64 = 8;

/// A file that is read and sought in.
pub trait InputFile: Read + Seek + Send {}

impl<T: Read + Seek + Send> InputFile for T {}

/// Whether a path is one of GDAL's virtual file systems.
#[must_use]
pub fn is_virtual(path: &Path) -> bool {
    static PREFIXES: OnceLock<Vec<String>> = OnceLock::new();
    let Some(text) = path.to_str().filter(|p| p.starts_with("/vsi")) else { return false };
    let known = PREFIXES.get_or_init(prefixes);
    known.iter().any(|prefix| prefix.len() > 1 && text.starts_with(prefix.as_str()))
}

/// Whether a path is read over a network.
#[must_use]
pub fn is_remote(path: &Path) -> bool {
    is_virtual(path) && path.to_str().is_some_and(|text| NETWORK.iter().any(|part| text.contains(part)))
}

/// The path of a URL: `/vsicurl/` for `https`, `http` and `ftp`, `/vsis3/` for `s3`, `/vsigs/` for `gs`, `/vsiaz/` for
/// `az`, the local path for `file`; `None` for other schemes, and for text that is no URL.
///
/// A slash in the query, as signatures may have it, becomes `%2F`, which is the same: the last part of the path is the file's name.
/// In a local path `%20` is a space, as URIs have it.
#[must_use]
pub fn from_url(text: &str) -> Option<PathBuf> {
    let (url, path) = URLS.iter().find(|(url, _)| text.starts_with(url))?;
    let rest = &text[url.len()..];
    if path.is_empty() {
        return Some(percent_decoded(rest).unwrap_or_else(|| rest.to_owned()).into());
    }
    let (place, query) = rest.split_at(rest.find('?').unwrap_or(rest.len()));
    Some(format!("{path}{place}{}", query.replace('/', "%2F")).into())
}

/// A path of a web server without the query of its URL, such as `?sig=1`, and the query; for other paths that is empty.
#[must_use]
pub fn split_query(path: &Path) -> (&Path, &str) {
    let of_server = path.to_str().filter(|text| text.contains("://") && is_virtual(path));
    match of_server.and_then(|text| text.find('?').map(|at| text.split_at(at))) {
        Some((place, query)) => (Path::new(place), query),
        None => (path, ""),
    }
}

/// A path of the folder of a file, with the query of the file's URL: signatures are of a folder or of the whole server.
fn with_name(file: &Path, name: &str) -> PathBuf {
    let (place, query) = split_query(file);
    place.with_file_name(format!("{name}{query}"))
}

/// A text whose bytes in hexadecimal, such as `%20`, are characters; `None` if they are no UTF-8.
#[must_use]
pub fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((first, after)) = rest.split_first() {
        let is_code = |digits: &&[u8]| digits.iter().all(u8::is_ascii_hexdigit);
        let code = after.get(..2).filter(is_code).and_then(|digits| std::str::from_utf8(digits).ok());
        match code.and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) if *first == b'%' => {
                bytes.push(byte);
                rest = &after[2..];
            }
            _ => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    String::from_utf8(bytes).ok()
}

/// The absolute path of a file or folder: virtual paths are absolute already, URLs become virtual paths ([`from_url`]).
///
/// # Errors
/// If the working folder is not known.
pub fn absolute(path: &Path) -> Result<PathBuf> {
    match path.to_str().and_then(from_url) {
        Some(path) => Ok(path),
        // `std::path::absolute` would make one slash of the two in a URL.
        None if is_virtual(path) => Ok(path.into()),
        None => std::path::absolute(path),
    }
}

/// A path relative to a folder. URLs become virtual paths ([`from_url`]), and in virtual folders `.` and `..` are resolved,
/// because object stores take them for names. Backslashes are the separators of Windows, unless a file has them in its name.
#[must_use]
pub fn join(folder: &Path, path: &Path) -> PathBuf {
    if let Some(path) = path.to_str().and_then(from_url) {
        return path;
    }
    let joined = join_slashes(folder, path);
    match path.to_str().filter(|text| text.contains('\\') && !exists(&joined)) {
        Some(text) => join_slashes(folder, Path::new(&text.replace('\\', "/"))),
        None => joined,
    }
}

fn join_slashes(folder: &Path, path: &Path) -> PathBuf {
    if path.is_absolute() || !is_virtual(folder) {
        return folder.join(path);
    }
    let mut joined = folder.to_path_buf();
    for part in path.components() {
        match part {
            Component::Normal(name) => joined.push(name),
            Component::ParentDir => drop(joined.pop()),
            _ => {}
        }
    }
    joined
}

/// Opens a file.
///
/// # Errors
/// Of the file system, or what GDAL says: the status of the server, missing credentials, …
pub fn open(path: &Path) -> Result<Box<dyn InputFile>> {
    if is_virtual(path) {
        Ok(Box::new(VsiFile::open(path)?))
    } else {
        Ok(Box::new(std::fs::File::open(path)?))
    }
}

/// Size of a regular file in bytes.
///
/// # Errors
/// As [`open`], and for folders, pipes and devices.
pub fn size(path: &Path) -> Result<u64> {
    if is_virtual(path) {
        return Ok(VsiFile::open(path)?.size());
    }
    let file = std::fs::metadata(path)?;
    if file.is_file() { Ok(file.len()) } else { Err(Error::other("not a regular file")) }
}

/// Content of a file.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Whether a file or folder exists and can be opened.
#[must_use]
pub fn exists(path: &Path) -> bool {
    if is_virtual(path) { VsiFile::open(path).is_ok() || is_dir(path) } else { path.exists() }
}

/// Whether a path is a folder. A web server's folder counts if the server lists it.
#[must_use]
pub fn is_dir(path: &Path) -> bool {
    if is_virtual(path) { list(path).is_ok_and(|names| !names.is_empty()) } else { path.is_dir() }
}

/// Files and folders in a folder; hidden ones are left out.
///
/// # Errors
/// Of the file system; of GDAL if it cannot list a virtual folder, or if that has more than 10,000 entries.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let names = if is_virtual(folder) {
        let found = names_in(folder, MOST_NAMES + 1)?;
        if found.len() > MOST_NAMES as usize {
            return Err(Error::other(format!("the folder has more than {MOST_NAMES} entries")));
        }
        found.into_iter().map(|name| name.trim_end_matches('/').into()).collect()
    } else {
        let names = std::fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name()));
        names.collect::<Result<Vec<_>>>()?
    };
    let shown = names.into_iter().filter(|name| !name.is_empty() && !name.to_string_lossy().starts_with('.'));
    Ok(shown.map(|name| folder.join(name)).collect())
}

/// The files in the folder of `file`. Of a virtual folder that cannot be listed, as that of a signed URL, or that the user asks
/// GDAL not to list (`GDAL_DISABLE_READDIR_ON_OPEN`), these are `file` and those that exist among some `likely` names.
///
/// # Errors
/// As [`list`], for a local folder.
pub fn files_beside(file: &Path, likely: &[String]) -> Result<Vec<PathBuf>> {
    let folder = file.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !is_virtual(file) {
        return list(folder);
    }
    if !super::gdal_setup::listing_is_off()
        && split_query(file).1.is_empty()
        && let Ok(found) = list(folder)
        && found.iter().any(|f| f == file)
    {
        return Ok(found);
    }
    let candidates = likely.par_iter().map(|name| with_name(file, name));
    let mut found: Vec<PathBuf> = candidates.filter(|path| VsiFile::open(path).is_ok()).collect();
    found.push(file.into());
    Ok(found)
}

/// Names of the files that GDAL reads with a remote raster: its own and those beside it.
pub(super) fn siblings(raster: &Path) -> Vec<String> {
    let name =
        split_query(raster).0.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let likely = OF_GDAL.map(|suffix| format!("{name}{suffix}"));
    let found = files_beside(raster, &likely).unwrap_or_default();
    found.iter().filter_map(|f| Some(f.file_name()?.to_str()?.to_owned())).collect()
}

/// A text that changes when a remote file does: its size, its `ETag` or, if the server states none, its `Last-Modified`,
/// and its first 16 KiB. The file is not read further.
///
/// # Errors
/// As [`open`].
pub fn identity(path: &Path) -> Result<String> {
    let mut file = VsiFile::open(path)?;
    let headers = headers(path);
    let header = |name: &str| {
        let of = |line: &String| {
            let (key, value) = line.split_once('=')?;
            key.eq_ignore_ascii_case(name).then(|| value.trim().to_owned())
        };
        headers.iter().find_map(of)
    };
    let version = header("ETag").or_else(|| header("Last-Modified")).unwrap_or_default();
    Ok(format!("{} bytes, {version}, {}", file.size(), sample(&mut file, 0)?.to_hex()))
}

/// Hash of the content of a file; of a remote one, of its size and of samples spread over it.
///
/// # Errors
/// As [`open`].
pub fn content_hash(path: &Path) -> Result<blake3::Hash> {
    let mut hasher = blake3::Hasher::new();
    if is_remote(path) {
        let mut file = VsiFile::open(path)?;
        let last = file.size().saturating_sub(SAMPLE);
        hasher.update(&file.size().to_le_bytes());
        for i in 0..SAMPLES {
            hasher.update(sample(&mut file, last / (SAMPLES - 1) * i)?.as_bytes());
        }
    } else {
        std::io::copy(&mut open(path)?, &mut hasher)?;
    }
    Ok(hasher.finalize())
}

/// Hash of [`SAMPLE`] bytes of a file from `at` on.
fn sample(file: &mut VsiFile, at: u64) -> Result<blake3::Hash> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(at))?;
    file.take(SAMPLE).read_to_end(&mut bytes)?;
    Ok(blake3::hash(&bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_of_gdal_are_told_from_local_ones() {
        for path in
            ["/vsis3/bucket/a.tif", "/vsicurl/https://host/a.tif", "/vsizip/vsicurl/https://host/a.zip/a.tif"]
        {
            assert!(is_virtual(Path::new(path)) && is_remote(Path::new(path)), "{path}");
        }
        let zip = Path::new("/vsizip//data/a.zip/a.tif");
        assert!(is_virtual(zip) && !is_remote(zip));
        for path in ["/vsidata/a.tif", "/vsi", "vsis3/a.tif", "/data/vsis3/a.tif", "a.tif"] {
            assert!(!is_virtual(Path::new(path)), "{path}");
        }
    }

    #[test]
    fn urls_become_paths_of_gdal() {
        let path = |url: &str| from_url(url).map(|p| p.to_string_lossy().into_owned());
        assert_eq!(path("https://host/a%20b.tif?x=1").unwrap(), "/vsicurl/https://host/a%20b.tif?x=1");
        assert_eq!(path("s3://bucket/key/a.tif").unwrap(), "/vsis3/bucket/key/a.tif");
        assert_eq!(path("gs://bucket/a.tif").unwrap(), "/vsigs/bucket/a.tif");
        assert_eq!(path("az://container/a.tif").unwrap(), "/vsiaz/container/a.tif");
        assert_eq!(path("file:///data/a.tif").unwrap(), "/data/a.tif");
        assert_eq!(path("file:///data/a%20b%c3%a9.tif").unwrap(), "/data/a bé.tif");
        assert_eq!(path("https://host/a.tif?s=a/b").unwrap(), "/vsicurl/https://host/a.tif?s=a%2Fb");
        assert_eq!((path("odd://a.tif"), path("a.tif")), (None, None));
    }

    #[test]
    fn the_query_of_a_url_is_no_part_of_the_name() {
        let file = Path::new("/vsicurl/https://host/a.tif?sig=a%2Fb&end=2030.5");
        assert_eq!(split_query(file), (Path::new("/vsicurl/https://host/a.tif"), "?sig=a%2Fb&end=2030.5"));
        assert_eq!(
            with_name(file, "a.rpc").to_str(),
            Some("/vsicurl/https://host/a.rpc?sig=a%2Fb&end=2030.5")
        );
        for path in ["/data/why?.tif", "/vsizip/a?b.zip/a.tif", "why?.tif"] {
            assert_eq!(split_query(Path::new(path)), (Path::new(path), ""));
        }
    }

    #[test]
    fn relative_paths_keep_the_slashes_of_a_url() {
        let folder = Path::new("/vsicurl/https://host/scene");
        let joined = |path: &str| join(folder, Path::new(path)).to_string_lossy().into_owned();
        assert_eq!(joined("./images/a.tif"), "/vsicurl/https://host/scene/images/a.tif");
        assert_eq!(joined("../a.tif"), "/vsicurl/https://host/a.tif");
        assert_eq!(joined("s3://b/a.tif"), "/vsis3/b/a.tif");
        assert_eq!(joined("/data/a.tif"), "/data/a.tif");
        assert_eq!(absolute(folder).unwrap().as_os_str(), folder.as_os_str());
        assert_eq!(join(Path::new("scene"), Path::new("./a.tif")), Path::new("scene/./a.tif"));
        assert_eq!(join(Path::new("scene"), Path::new("images\\a.tif")), Path::new("scene/images/a.tif"));
    }

    #[test]
    fn what_cannot_be_reached_is_an_error_in_the_words_of_gdal() {
        // Nothing listens on port 9.
        let error = size(Path::new("/vsicurl/http://127.0.0.1:9/a.tif")).unwrap_err().to_string();
        assert!(error.contains("connect"), "{error}");
        assert!(size(Path::new("/vsizip//no/such.zip/a.tif")).is_err());
        assert!(size(Path::new(".")).unwrap_err().to_string().contains("not a regular file"));
    }
}

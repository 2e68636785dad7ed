//! GDAL's functions for files of its virtual file systems, as Rust functions.

#![allow(unsafe_code)]

use super::gdal_setup::{remote_options, set_up_gdal};
use gdal_sys::{CPLErrorReset, CPLGetLastErrorMsg, CSLDestroy, VSILFILE};
use std::ffi::{CStr, CString, c_char, c_int};
use std::io::{Error, Read, Result, Seek, SeekFrom};
use std::path::Path;
use std::ptr::null_mut;

// Of `cpl_vsi_error.h`, which the bindings of `gdal-sys` leave out.
unsafe extern "C" {
    fn VSIGetLastErrorMsg() -> *const c_char;
    fn VSIErrorReset();
}

/// The prefixes of the virtual file systems of this GDAL, such as `/vsicurl/`.
pub(super) fn prefixes() -> Vec<String> {
    // SAFETY: the list is owned by the caller.
    unsafe { strings(gdal_sys::VSIGetFileSystemsPrefixes()) }
}

/// Names in a folder, at most `most`.
pub(super) fn names_in(folder: &Path, most: c_int) -> Result<Vec<String>> {
    let path = c_path(folder)?;
    fresh();
    // SAFETY: the path is a C string, and the list is owned by the caller.
    let list = unsafe { gdal_sys::VSIReadDirEx(path.as_ptr(), most) };
    if list.is_null() {
        return Err(last_error("GDAL cannot list it"));
    }
    // SAFETY: as above.
    Ok(unsafe { strings(list) })
}

/// The header lines `KEY=VALUE` with which a web server describes a file; none for other file systems.
pub(super) fn headers(file: &Path) -> Vec<String> {
    let Ok(path) = c_path(file) else { return Vec::new() };
    fresh();
    let _options = remote_options();
    // SAFETY: both are C strings, and the list is owned by the caller.
    unsafe { strings(gdal_sys::VSIGetFileMetadata(path.as_ptr(), c"HEADERS".as_ptr(), null_mut())) }
}

/// A file opened for reading.
pub(super) struct VsiFile {
    handle: *mut VSILFILE,
    bytes: u64,
}

// SAFETY: a handle may be used by one thread at a time, whichever it is.
unsafe impl Send for VsiFile {}

impl VsiFile {
    /// Opens a file; the error is GDAL's.
    pub(super) fn open(file: &Path) -> Result<Self> {
        let path = c_path(file)?;
        fresh();
        let _options = remote_options();
        // SAFETY: both are C strings. 1 asks for an error message.
        let handle = unsafe { gdal_sys::VSIFOpenExL(path.as_ptr(), c"rb".as_ptr(), 1) };
        if handle.is_null() {
            return Err(last_error("GDAL cannot open it"));
        }
        let mut opened = Self { handle, bytes: 0 };
        opened.bytes = opened.seek_raw(0, 2)?;
        opened.seek_raw(0, 0)?;
        Ok(opened)
    }

    /// Size in bytes.
    pub(super) fn size(&self) -> u64 {
        self.bytes
    }

    fn seek_raw(&mut self, offset: u64, whence: c_int) -> Result<u64> {
        // SAFETY: the handle is open.
        unsafe {
            if gdal_sys::VSIFSeekL(self.handle, offset, whence) != 0 {
                return Err(last_error("GDAL cannot seek in it"));
            }
            Ok(gdal_sys::VSIFTellL(self.handle))
        }
    }
}

impl Read for VsiFile {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        fresh();
        // SAFETY: the handle is open, and the buffer is as long as stated.
        let (read, at) = unsafe {
            let read = gdal_sys::VSIFReadL(buffer.as_mut_ptr().cast(), 1, buffer.len(), self.handle);
            (read, gdal_sys::VSIFTellL(self.handle))
        };
        // GDAL returns fewer bytes at the end of the file and after an error alike.
        if read == 0 && !buffer.is_empty() && at < self.bytes {
            return Err(last_error("GDAL cannot read it to its end"));
        }
        Ok(read)
    }
}

impl Seek for VsiFile {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let (from, by) = match to {
            SeekFrom::Start(at) => return self.seek_raw(at, 0),
            SeekFrom::End(by) => (self.bytes, by),
            SeekFrom::Current(by) => (self.seek_raw(0, 1)?, by),
        };
        let at = from.checked_add_signed(by).ok_or_else(|| Error::other("a position before the file"))?;
        self.seek_raw(at, 0)
    }
}

impl Drop for VsiFile {
    fn drop(&mut self) {
        // SAFETY: the handle is open, and nobody uses it after this.
        unsafe { gdal_sys::VSIFCloseL(self.handle) };
    }
}

fn c_path(path: &Path) -> Result<CString> {
    let text = path.to_str().ok_or_else(|| Error::other("its name is not UTF-8"))?;
    CString::new(text).map_err(|_| Error::other("its name holds a zero byte"))
}

/// Forgets earlier errors of this thread, so that the last one is that of the next call.
fn fresh() {
    set_up_gdal();
    // SAFETY: both only clear the state of this thread.
    unsafe {
        CPLErrorReset();
        VSIErrorReset();
    }
}

/// What GDAL says about the last call, or `otherwise` if it says nothing.
fn last_error(otherwise: &str) -> Error {
    let text = |message: *const c_char| {
        // SAFETY: GDAL's message is a C string until the next call on this thread.
        let text = (!message.is_null()).then(|| unsafe { CStr::from_ptr(message) }.to_string_lossy());
        text.filter(|t| !t.trim().is_empty()).map(|t| t.trim().to_owned())
    };
    // SAFETY: both return a C string of this thread.
    let (of_file, of_gdal) = unsafe { (VSIGetLastErrorMsg(), CPLGetLastErrorMsg()) };
    Error::other(text(of_file).or_else(|| text(of_gdal)).unwrap_or_else(|| otherwise.into()))
}

/// Copies and frees a list of GDAL; empty for none.
///
/// # Safety
/// `list` is null or a list of C strings that ends with null, which the caller owns.
unsafe fn strings(list: *mut *mut c_char) -> Vec<String> {
    let mut out = Vec::new();
    if list.is_null() {
        return out;
    }
    // SAFETY: by the contract of this function.
    unsafe {
        let mut at = list;
        while !(*at).is_null() {
            out.push(CStr::from_ptr(*at).to_string_lossy().into_owned());
            at = at.add(1);
        }
        CSLDestroy(list);
    }
    out
}

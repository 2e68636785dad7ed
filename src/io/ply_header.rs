//! Headers of PLY files (Turk 1994).

use super::decode_text;

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Result<Self, String> {
        Ok(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(format!("its header names the type `{name}`, which PLY does not have")),
        })
    }

    /// Bytes of a number in a binary file.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// A number from its bytes, little-endian.
    pub fn value(self, bytes: &[u8]) -> Option<f64> {
        Some(match self {
            Self::I8 => f64::from(i8::from_le_bytes(bytes.try_into().ok()?)),
            Self::U8 => f64::from(u8::from_le_bytes(bytes.try_into().ok()?)),
            Self::I16 => f64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
            Self::U16 => f64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
            Self::I32 => f64::from(i32::from_le_bytes(bytes.try_into().ok()?)),
            Self::U32 => f64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
            Self::F32 => f64::from(f32::from_le_bytes(bytes.try_into().ok()?)),
            Self::F64 => f64::from_le_bytes(bytes.try_into().ok()?),
        })
    }
}

/// A property of an element: a number, or a list with the type of its length.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub length: Option<Scalar>,
    pub item: Scalar,
}

/// A kind of element, in the order of the file.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

impl Element {
    /// Fewest bytes that an element can have.
    pub fn least_bytes(&self, is_ascii: bool) -> usize {
        let of = |p: &Property| if is_ascii { 1 } else { p.length.unwrap_or(p.item).size() };
        self.properties.iter().map(of).sum()
    }

    /// The place of a property.
    pub fn place(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }
}

/// A parsed header.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub is_ascii: bool,
    pub elements: Vec<Element>,
    /// Bytes of the header.
    pub length: usize,
}

impl Header {
    /// Parses the header at the start of a file.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        const END: &[u8] = b"end_header";
        if !bytes.starts_with(b"ply") {
            return Err("it does not begin with `ply`".into());
        }
        let end = bytes.windows(END.len()).position(|w| w == END).ok_or("its header has no `end_header`")?;
        let line = bytes[end..].iter().position(|b| *b == b'\n').ok_or("it ends with its header")?;
        let text = decode_text(&bytes[..end]);
        let mut is_ascii = None;
        let mut elements = Vec::<Element>::new();
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["format", "ascii", _] => is_ascii = Some(true),
                ["format", "binary_little_endian", _] => is_ascii = Some(false),
                ["format", other, ..] => return Err(format!("its format is `{other}`")),
                ["element", name, count] => {
                    let count = count
                        .parse()
                        .map_err(|_| format!("its header announces `{count}` elements `{name}`"))?;
                    elements.push(Element { name: (*name).into(), count, properties: Vec::new() });
                }
                ["property", rest @ ..] => {
                    let property = property(rest).map_err(|e| format!("{e}, in `{line}`"))?;
                    elements
                        .last_mut()
                        .ok_or("a property stands before all elements")?
                        .properties
                        .push(property);
                }
                _ => {}
            }
        }
        let is_ascii = is_ascii.ok_or("its header names no format")?;
        Ok(Self { is_ascii, elements, length: end + line + 1 })
    }
}

fn property(words: &[&str]) -> Result<Property, String> {
    match words {
        ["list", length, item, name] => Ok(Property {
            name: (*name).into(),
            length: Some(Scalar::named(length)?),
            item: Scalar::named(item)?,
        }),
        [item, name] => Ok(Property { name: (*name).into(), length: None, item: Scalar::named(item)? }),
        _ => Err("a property has a type and a name".into()),
    }
}

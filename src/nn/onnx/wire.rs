//! Reading of Protocol Buffers messages (<https://protobuf.dev/programming-guides/encoding/>), of which ONNX files are made.
//!
//! Every length is compared with the bytes that there are.

use super::fault::Fault;

/// A part of the file, and where it starts.
#[derive(Clone, Copy)]
pub struct Slice<'a> {
    pub bytes: &'a [u8],
    pub start: usize,
}

impl<'a> Slice<'a> {
    /// A whole file.
    pub fn file(bytes: &'a [u8]) -> Self {
        Self { bytes, start: 0 }
    }

    /// The fields of the message that the bytes are.
    pub fn fields(self) -> Fields<'a> {
        Fields { rest: self }
    }

    /// The first field of a number, if it has a length: text, bytes or a message.
    pub fn first(self, number: u64) -> Result<Option<Self>, Fault> {
        for field in self.fields() {
            let field = field?;
            if field.number == number {
                return Ok(field.content());
            }
        }
        Ok(None)
    }

    /// The first field of a number, as text.
    pub fn text(self, number: u64) -> Result<Option<&'a str>, Fault> {
        self.first(number)?.map(Self::as_text).transpose()
    }

    /// All fields of a number, as texts.
    pub fn texts(self, number: u64) -> Result<Vec<&'a str>, Fault> {
        self.all(number)?.into_iter().map(Self::as_text).collect()
    }

    /// All fields of a number that have a length.
    pub fn all(self, number: u64) -> Result<Vec<Self>, Fault> {
        let mut found = Vec::new();
        for field in self.fields() {
            let field = field?;
            if field.number == number {
                found.extend(field.content());
            }
        }
        Ok(found)
    }

    /// The whole numbers of a repeated field, packed or not.
    pub fn integers(self, number: u64) -> Result<Vec<i64>, Fault> {
        let mut values = Vec::new();
        for field in self.fields() {
            let field = field?;
            match field.value {
                FieldValue::Varint(value) if field.number == number => values.push(value as i64),
                FieldValue::Content(mut packed) if field.number == number => {
                    while !packed.bytes.is_empty() {
                        values.push(packed.take_varint()? as i64);
                    }
                }
                _ => {}
            }
        }
        Ok(values)
    }

    /// The numbers of single precision of a repeated field, packed or not.
    pub fn floats(self, number: u64) -> Result<Vec<f32>, Fault> {
        let mut values = Vec::new();
        for field in self.fields() {
            let field = field?;
            if let (true, FieldValue::Fixed(bytes) | FieldValue::Content(bytes)) =
                (field.number == number, field.value)
            {
                values.extend(bytes.as_floats());
            }
        }
        Ok(values)
    }

    /// Numbers of single precision, the lowest byte first.
    pub fn as_floats(self) -> impl Iterator<Item = f32> + 'a {
        self.bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b))
    }

    fn as_text(self) -> Result<&'a str, Fault> {
        std::str::from_utf8(self.bytes)
            .map_err(|_| Fault::Damaged { at: self.start, reason: "a text is not UTF-8" })
    }

    /// Takes the first `length` bytes off.
    fn take(&mut self, length: u64) -> Result<Self, Fault> {
        let split = usize::try_from(length).ok().and_then(|length| self.bytes.split_at_checked(length));
        let (first, rest) =
            split.ok_or(Fault::Damaged { at: self.start, reason: "a field is longer than the rest" })?;
        let taken = Self { bytes: first, start: self.start };
        *self = Self { bytes: rest, start: self.start + first.len() };
        Ok(taken)
    }

    /// Takes an integer of variable length off: seven bits a byte, the lowest first.
    fn take_varint(&mut self) -> Result<u64, Fault> {
        let mut value = 0;
        for (k, byte) in self.bytes.iter().take(10).enumerate() {
            value |= u64::from(byte & 0x7F) << (7 * k);
            if byte & 0x80 == 0 {
                self.take(k as u64 + 1)?;
                return Ok(value);
            }
        }
        Err(Fault::Damaged { at: self.start, reason: "an integer does not end" })
    }
}

/// A field of a message.
pub struct Field<'a> {
    pub number: u64,
    pub start: usize,
    pub value: FieldValue<'a>,
    /// The bytes of the field, its number and length included.
    pub bytes: &'a [u8],
}

/// What a field holds.
#[derive(Clone, Copy)]
pub enum FieldValue<'a> {
    /// A number of variable length.
    Varint(u64),
    /// A number of four or eight bytes.
    Fixed(Slice<'a>),
    /// Text, bytes, packed numbers or a message.
    Content(Slice<'a>),
}

impl<'a> Field<'a> {
    /// Text, bytes or a message; none of a number.
    pub fn content(&self) -> Option<Slice<'a>> {
        match self.value {
            FieldValue::Content(content) => Some(content),
            FieldValue::Varint(_) | FieldValue::Fixed(_) => None,
        }
    }
}

/// The fields of a message; ends after the first damaged one.
pub struct Fields<'a> {
    rest: Slice<'a>,
}

impl<'a> Fields<'a> {
    fn field(&mut self) -> Result<Field<'a>, Fault> {
        let Slice { bytes, start } = self.rest;
        let tag = self.rest.take_varint()?;
        let value = match tag & 7 {
            0 => FieldValue::Varint(self.rest.take_varint()?),
            1 => FieldValue::Fixed(self.rest.take(8)?),
            2 => {
                let length = self.rest.take_varint()?;
                FieldValue::Content(self.rest.take(length)?)
            }
            5 => FieldValue::Fixed(self.rest.take(4)?),
            _ => return Err(Fault::Damaged { at: start, reason: "a field has no known type" }),
        };
        let bytes = &bytes[..self.rest.start - start];
        Ok(Field { number: tag >> 3, start, value, bytes })
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<Field<'a>, Fault>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.bytes.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.rest.bytes = &[];
        }
        Some(field)
    }
}

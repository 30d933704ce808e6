//! Edits of a valid input, chosen by the bytes of a fuzzer.

use arbitrary::Unstructured;
use serde_json::{Map, Value, json};

/// Maximum number of edits of the bytes of one input. Few leave it close to a valid one.
const MAX_EDITS: usize = 4;
/// Numbers at the limits of the types that a parser may use, and texts that look like numbers.
const NUMBERS: [&str; 20] = [
    "0",
    "-0",
    "-1",
    "1",
    "3",
    "255",
    "65536",
    "4294967295",
    "4294967296",
    "-2147483649",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "1e38",
    "1e39",
    "1e308",
    "1e999",
    "1e-320",
    "NaN",
];
/// Bytes with a meaning in some format.
const BYTES: [u8; 16] = *b"\0\"\n\\{}[]:,'#\x1b\x7f\x80\xff";
/// Words with a meaning in some format.
const WORDS: [&str; 12] = [
    "null",
    "true",
    "[]",
    "{}",
    "\"\"",
    "inf",
    "../",
    "/dev/zero",
    "&a *a",
    "\u{fffd}",
    "\u{1b}[2J",
    "é\u{301}",
];
/// Marks a key that occurs twice in an object, which a map cannot hold. Removed from the text.
const DUPLICATE: &str = "§duplicate§";

/// A sequence of choices. When the bytes are used up, every further choice is the first.
#[derive(Debug)]
pub struct Edits<'a>(Unstructured<'a>);

impl<'a> Edits<'a> {
    /// Starts with the first of the bytes.
    #[must_use]
    pub fn new(data: &'a [u8]) -> Self {
        Self(Unstructured::new(data))
    }

    /// Returns a number below `n`, which must not be 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.0.int_in_range(0..=n - 1).unwrap_or(0)
    }

    /// Returns an element of a list that is not empty.
    pub fn pick<'b, T>(&mut self, all: &'b [T]) -> &'b T {
        &all[self.below(all.len())]
    }

    /// Returns a word of a list that is not empty.
    pub fn word<'b>(&mut self, all: &[&'b str]) -> &'b str {
        all[self.below(all.len())]
    }

    /// Returns a 64-bit number, often an extreme one.
    pub fn number(&mut self) -> u64 {
        const EXTREMES: [u64; 10] =
            [0, 1, 2, 63, 64, 255, u32::MAX as u64, 1 << 32, i64::MAX as u64, u64::MAX];
        match self.below(3) {
            0 => *self.pick(&EXTREMES),
            1 => self.0.arbitrary().unwrap_or(0),
            _ => self.pick(&EXTREMES).wrapping_add(self.below(5) as u64).wrapping_sub(2),
        }
    }

    /// Returns up to `n` bytes as they are.
    pub fn literal(&mut self, n: usize) -> &'a [u8] {
        let len = self.below(n + 1).min(self.0.len());
        self.0.bytes(len).unwrap_or_default()
    }

    /// Returns `true` if no choice is left.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Edits bytes up to four times, until the choices are used up.
    pub fn bytes(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..self.below(MAX_EDITS + 1) {
            if self.is_empty() {
                return;
            }
            self.edit(bytes);
        }
    }

    /// Edits a text like bytes; what is then not UTF-8 is replaced.
    pub fn text(&mut self, text: &str) -> String {
        let mut bytes = text.as_bytes().to_vec();
        self.bytes(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Edits a JSON text: first its values, then possibly its bytes.
    pub fn json(&mut self, text: &[u8]) -> Vec<u8> {
        let Ok(mut value) = serde_json::from_slice::<Value>(text) else {
            let mut bytes = text.to_vec();
            self.bytes(&mut bytes);
            return bytes;
        };
        for _ in 0..=self.below(3) {
            self.value(&mut value);
        }
        let mut bytes = value.to_string().replace(DUPLICATE, "").into_bytes();
        if self.below(4) == 0 {
            self.bytes(&mut bytes);
        }
        bytes
    }

    /// Edits one value of a JSON document.
    pub fn value(&mut self, document: &mut Value) {
        if self.is_empty() {
            return;
        }
        let mut pointers = Vec::new();
        list_pointers(document, String::new(), &mut pointers);
        let [other, pointer] = [self.below(pointers.len()), self.below(pointers.len())];
        let other = document.pointer(&pointers[other]).cloned().unwrap_or_default();
        let Some(node) = document.pointer_mut(&pointers[pointer]) else { return };
        match self.below(7) {
            0 => *node = self.extreme(),
            1 => *node = other,
            2 => *node = json!([node.take()]),
            3 => self.remove(node),
            4 => self.duplicate(node),
            5 => self.rename(node),
            _ => *node = (0..200).fold(node.take(), |inner, _| json!([inner])),
        }
    }

    fn extreme(&mut self) -> Value {
        match self.below(8) {
            0 => Value::Null,
            1 => json!(self.below(2) == 1),
            2 => json!(self.number()),
            3 => json!(self.number().cast_signed()),
            4 => serde_json::from_str(self.word(&NUMBERS)).unwrap_or(Value::Null),
            5 => json!(self.word(&WORDS)),
            6 => json!("x".repeat(self.below(3000))),
            _ => json!(vec![self.below(3); self.below(300)]),
        }
    }

    fn remove(&mut self, node: &mut Value) {
        match node {
            Value::Object(map) if !map.is_empty() => {
                let key = self.key(map);
                map.remove(&key);
            }
            Value::Array(list) if !list.is_empty() => {
                list.remove(self.below(list.len()));
            }
            other => *other = Value::Null,
        }
    }

    fn duplicate(&mut self, node: &mut Value) {
        match node {
            Value::Object(map) if !map.is_empty() => {
                let key = self.key(map);
                let value = if self.below(2) == 0 { map[&key].clone() } else { self.extreme() };
                map.insert(format!("{key}{DUPLICATE}"), value);
            }
            Value::Array(list) if !list.is_empty() => {
                let copy = self.pick(list).clone();
                let times = 1 + self.below(40);
                list.extend(std::iter::repeat_n(copy, times));
            }
            other => *other = self.extreme(),
        }
    }

    fn rename(&mut self, node: &mut Value) {
        match node {
            Value::Object(map) if !map.is_empty() => {
                let key = self.key(map);
                let value = map.remove(&key).unwrap_or_default();
                let renamed = self.text(&key);
                map.insert(renamed, value);
            }
            Value::String(text) => *text = self.text(text),
            other => *other = self.extreme(),
        }
    }

    fn key(&mut self, map: &Map<String, Value>) -> String {
        map.keys().nth(self.below(map.len())).cloned().unwrap_or_default()
    }

    /// Edits bytes once.
    fn edit(&mut self, bytes: &mut Vec<u8>) {
        let at = self.below(bytes.len() + 1);
        let range = at..(at + self.below(64)).min(bytes.len());
        match self.below(10) {
            0 => bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << self.below(8)),
            1 => bytes.insert(at, *self.pick(&BYTES)),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(range)),
            4 => {
                let copy = bytes[range].to_vec();
                let to = self.below(bytes.len() + 1);
                bytes.splice(to..to, copy);
            }
            5 => {
                let number = self.number().to_le_bytes();
                let len = (bytes.len() - at).min(1 << self.below(4));
                bytes[at..at + len].copy_from_slice(&number[..len]);
            }
            6 => self.number_at(bytes, at),
            7 => drop(bytes.splice(at..at, self.word(&WORDS).bytes())),
            8 => drop(bytes.splice(at..at, self.literal(32).iter().copied())),
            _ => *bytes = self.literal(512).to_vec(),
        }
    }

    /// Replaces the first number after a position.
    fn number_at(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let is_part = |byte: &u8| byte.is_ascii_digit() || b".-+eE".contains(byte);
        let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|offset| at + offset) else {
            return;
        };
        let len = bytes[start..].iter().take_while(|byte| is_part(byte)).count();
        bytes.splice(start..start + len, self.word(&NUMBERS).bytes());
    }
}

/// Collects the pointers of all values in a document.
fn list_pointers(value: &Value, pointer: String, pointers: &mut Vec<String>) {
    match value {
        Value::Object(map) => map.iter().for_each(|(key, inner)| {
            let key = key.replace('~', "~0").replace('/', "~1");
            list_pointers(inner, format!("{pointer}/{key}"), pointers);
        }),
        Value::Array(list) => list
            .iter()
            .enumerate()
            .for_each(|(idx, inner)| list_pointers(inner, format!("{pointer}/{idx}"), pointers)),
        _ => {}
    }
    pointers.push(pointer);
}

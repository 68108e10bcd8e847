//! Arm motions as CSV, the form recordings and the shipped sample come in.
//!
//! The first line names the columns. One line a frame follows:
//!
//! | column | what | unit |
//! |---|---|---|
//! | `time` | strictly increasing | s |
//! | `sx` `sy` `sz` | the shoulder | m |
//! | `ex` `ey` `ez` | the elbow | m |
//! | `wx` `wy` `wz` | the wrist | m |
//! | `hx` `hy` `hz` | the hand, or the wrist again where it was not recorded | m |
//! | `phase`, if it was marked | 0 rest, 1 out to the target, 2 at it, 3 back, 4 rest | |
//!
//! Columns are found by their names, in any order; other columns are ignored. Fields are separated by commas and may be
//! quoted; spaces around them, a byte order mark, blank lines and any line ending are fine. Everything else that is not as it
//! should be is an error that says in which line and column, what is there and what was expected.

use crate::motion::{Motion, MotionError, Phase, Point, Recorded, distance};
use ::csv::{ReaderBuilder, StringRecord};
use std::fmt;
use std::io::{self, Read, Write};
use std::path::Path;

/// The landmarks of an arm and their columns, in chain order.
const LANDMARKS: [(&str, [&str; 3]); 4] = [
    ("shoulder", ["sx", "sy", "sz"]),
    ("elbow", ["ex", "ey", "ez"]),
    ("wrist", ["wx", "wy", "wz"]),
    ("hand", ["hx", "hy", "hz"]),
];

/// No segment of an arm is longer, m. One that is was not measured in metres.
const LONGEST_SEGMENT: f64 = 3.0;

const TIME: &str = "time";
const PHASE: &str = "phase";

/// A line of a file. Shown as `FILE, line N`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// The file's path, or the name given for what was parsed.
    pub file: String,
    /// Counted from 1; the header is a line too.
    pub number: usize,
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, line {}", self.file, self.number)
    }
}

/// Why a file is no recording of an arm, or a motion cannot be written as one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CsvError {
    /// The operating system does not let the file be read.
    #[error("{file}: cannot be read: {source}")]
    Unreadable {
        /// The file.
        file: String,
        /// Why not.
        source: io::Error,
    },
    /// The file is not text.
    #[error(
        "{line}: byte {byte} of the line is not UTF-8, expected a text file of comma-separated values"
    )]
    NotText {
        /// Where.
        line: Line,
        /// Counted from 1 in that line.
        byte: usize,
    },
    /// There is nothing in the file.
    #[error("{file}: the file is empty, expected a line of column names and a line a frame")]
    Empty {
        /// The file.
        file: String,
    },
    /// The header's names are separated by something else than commas.
    #[error("{line}: column names are separated by {found:?}, expected commas")]
    Separator {
        /// The header.
        line: Line,
        /// What separates them.
        found: char,
    },
    /// The header lacks a column.
    #[error("{line}: there is no column {column:?}, expected it among the columns found: {found}")]
    MissingColumn {
        /// The header.
        line: Line,
        /// What it lacks.
        column: &'static str,
        /// What it has.
        found: String,
    },
    /// The header has a column twice, and which is meant is anyone's guess.
    #[error("{line}: there are {found} columns {column:?}, expected one")]
    RepeatedColumn {
        /// The header.
        line: Line,
        /// The column.
        column: &'static str,
        /// How often it is there.
        found: usize,
    },
    /// A line has more or fewer fields than the header.
    #[error("{line}: fields found: {found}, expected {expected}, as many as column names")]
    FieldCount {
        /// The line.
        line: Line,
        /// Its fields.
        found: usize,
        /// The header's.
        expected: usize,
    },
    /// A field is blank.
    #[error("{line}, column {column:?}: the field is blank, expected {expected}")]
    Blank {
        /// The line.
        line: Line,
        /// The column.
        column: &'static str,
        /// What ought to be there.
        expected: &'static str,
    },
    /// A field is not what its column holds.
    #[error("{line}, column {column:?}: found {found:?}, expected {expected}")]
    Field {
        /// The line.
        line: Line,
        /// The column.
        column: &'static str,
        /// What is there.
        found: String,
        /// What ought to be there.
        expected: &'static str,
    },
    /// Time stands still or runs backwards.
    #[error(
        "{line}, column \"time\": found {found} s after {before} s in the frame before, expected a later time"
    )]
    TimeNotIncreasing {
        /// The later frame's line.
        line: Line,
        /// Its time, s.
        found: f64,
        /// The time of the frame before it, s.
        before: f64,
    },
    /// Two neighbouring landmarks are farther apart than any arm is long.
    #[error(
        "{line}, columns {from_column:?} and {to_column:?}: found the {from} and the {to} {length:.1} apart, expected less than {LONGEST_SEGMENT}: positions must be metres (are these millimetres or centimetres?)"
    )]
    NotMetres {
        /// The line.
        line: Line,
        /// The first column of the landmark nearer to the base.
        from_column: &'static str,
        /// The first column of the other landmark.
        to_column: &'static str,
        /// The landmark nearer to the base.
        from: &'static str,
        /// The other landmark.
        to: &'static str,
        /// How far apart they are, in the file's unit.
        length: f64,
    },
    /// The file ends too soon.
    #[error("{line}: the file ends here, frames found: {frames}, expected at least 2")]
    TooFewFrames {
        /// The last line that was read.
        line: Line,
        /// How many frames there are.
        frames: usize,
    },
    /// The frames make no motion for another reason.
    #[error("{file}: {source}")]
    NoMotion {
        /// The file.
        file: String,
        /// The reason.
        source: MotionError,
    },
    /// A motion to be written has other landmarks than an arm.
    #[error("motion {name:?} has {found} landmarks, expected the 4 of an arm")]
    NotAnArm {
        /// The motion's name.
        name: String,
        /// How many landmarks it has.
        found: usize,
    },
    /// A motion to be written has frames that four decimals of a second cannot tell apart.
    #[error(
        "motion {name:?}, frame {frame}: found the frame before less than 0.1 ms earlier, expected times that differ in four decimals"
    )]
    TooDense {
        /// The motion's name.
        name: String,
        /// The later frame, counted from 0.
        frame: usize,
    },
    /// The text could not be written.
    #[error("motion {name:?} cannot be written: {source}")]
    Unwritable {
        /// The motion's name.
        name: String,
        /// Why not.
        source: io::Error,
    },
}

/// Reads the recording in a file. The motion is named as the file is, without its ending.
///
/// # Errors
/// Says what is wrong with the file and where.
pub fn read(path: impl AsRef<Path>) -> Result<Motion, CsvError> {
    let path = path.as_ref();
    let file = path.display().to_string();
    let name = path
        .file_stem()
        .map_or_else(|| file.clone(), |stem| stem.to_string_lossy().into_owned());
    match std::fs::read(path) {
        Ok(bytes) => parse_bytes(&bytes, &file, &name),
        Err(source) => Err(CsvError::Unreadable { file, source }),
    }
}

/// Reads a recording from anywhere. Errors and the motion call it by `name`.
///
/// # Errors
/// Says what is wrong with the text and where.
pub fn parse(mut reader: impl Read, name: &str) -> Result<Motion, CsvError> {
    let mut bytes = Vec::new();
    match reader.read_to_end(&mut bytes) {
        Ok(_) => parse_bytes(&bytes, name, name),
        Err(source) => Err(CsvError::Unreadable {
            file: name.to_owned(),
            source,
        }),
    }
}

/// Writes the motion of an arm: times and positions with four decimals, and the phase where it is marked.
///
/// # Errors
/// [`CsvError::NotAnArm`] and [`CsvError::TooDense`] where the form cannot hold the motion, [`CsvError::Unwritable`] where
/// the writer fails.
pub fn write(motion: &Motion, mut writer: impl Write) -> Result<(), CsvError> {
    writer
        .write_all(to_text(motion)?.as_bytes())
        .map_err(|source| CsvError::Unwritable {
            name: motion.name().to_owned(),
            source,
        })
}

fn to_text(motion: &Motion) -> Result<String, CsvError> {
    if motion.landmarks().len() != LANDMARKS.len() {
        return Err(CsvError::NotAnArm {
            name: motion.name().to_owned(),
            found: motion.landmarks().len(),
        });
    }
    let phases = motion.phases();
    let mut names = vec![TIME];
    names.extend(LANDMARKS.iter().flat_map(|(_, columns)| columns));
    names.extend(phases.map(|_| PHASE));
    let mut text = names.join(",") + "\n";
    let mut before = String::new();
    for (frame, (time, points)) in motion.times().iter().zip(motion.points()).enumerate() {
        let time = four_decimals(*time);
        if time == before {
            return Err(CsvError::TooDense {
                name: motion.name().to_owned(),
                frame,
            });
        }
        text.push_str(&time);
        for x in points.iter().flatten() {
            text.push(',');
            text.push_str(&four_decimals(*x));
        }
        if let Some(phase) = phases.and_then(|phases| phases.get(frame)) {
            text.push_str(&format!(",{phase}"));
        }
        text.push('\n');
        before = time;
    }
    Ok(text)
}

/// The number with four decimals, zero without a sign.
fn four_decimals(x: f64) -> String {
    let text = format!("{x:.4}");
    if text == "-0.0000" {
        "0.0000".to_owned()
    } else {
        text
    }
}

fn parse_bytes(bytes: &[u8], file: &str, name: &str) -> Result<Motion, CsvError> {
    let text = text_of(bytes, file)?;
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(::csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut lines = LineCounter::new(text, file);
    let mut record = StringRecord::new();

    if !next(&mut reader, &mut record, file)? {
        return Err(CsvError::Empty {
            file: file.to_owned(),
        });
    }
    let mut line = lines.line_of(&record);
    let columns = Columns::find(&record, &line)?;

    let mut times: Vec<f64> = Vec::new();
    let mut points = Vec::new();
    let mut phases = columns.phase.is_some().then(Vec::new);
    while next(&mut reader, &mut record, file)? {
        line = lines.line_of(&record);
        let fields = columns.fields(&record, &line)?;
        let time = fields.time(times.last().copied())?;
        times.push(time);
        points.push(fields.arm()?);
        if let (Some(phases), Some(column)) = (&mut phases, columns.phase) {
            phases.push(fields.phase(column)?);
        }
    }
    if times.len() < 2 {
        return Err(CsvError::TooFewFrames {
            line,
            frames: times.len(),
        });
    }
    Motion::new(Recorded {
        name: name.to_owned(),
        landmarks: LANDMARKS
            .iter()
            .map(|(name, _)| (*name).to_owned())
            .collect(),
        times,
        points,
        phases,
    })
    .map_err(|source| CsvError::NoMotion {
        file: file.to_owned(),
        source,
    })
}

/// The bytes as text, without a byte order mark.
fn text_of<'a>(bytes: &'a [u8], file: &str) -> Result<&'a str, CsvError> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let good = bytes.get(..error.valid_up_to()).unwrap_or_default();
        let line_start = good
            .iter()
            .rposition(|b| *b == b'\n' || *b == b'\r')
            .map_or(0, |i| i + 1);
        CsvError::NotText {
            line: Line {
                file: file.to_owned(),
                number: 1 + line_ends(good),
            },
            byte: good.len() - line_start + 1,
        }
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}

/// Reads the next record that is not blank; false at the end.
fn next(
    reader: &mut ::csv::Reader<&[u8]>,
    record: &mut StringRecord,
    file: &str,
) -> Result<bool, CsvError> {
    // The text is in memory, is UTF-8 and may have lines of any length: what can fail is reading, which cannot.
    reader
        .read_record(record)
        .map_err(|error| CsvError::Unreadable {
            file: file.to_owned(),
            source: error.into(),
        })
}

/// Counts lines as an editor does. (The reader's own count lags behind after blank lines and after CR LF.)
struct LineCounter<'a> {
    file: &'a str,
    rest: &'a str,
    /// Where `rest` begins, in bytes.
    at: usize,
    /// The number of the line it begins in, from 1.
    number: usize,
}

impl<'a> LineCounter<'a> {
    fn new(text: &'a str, file: &'a str) -> Self {
        Self {
            file,
            rest: text,
            at: 0,
            number: 1,
        }
    }

    /// The line that a record starts in. Records are asked for in the order of the text.
    fn line_of(&mut self, record: &StringRecord) -> Line {
        let byte = record.position().map_or(0, |position| position.byte());
        let mut skip = usize::try_from(byte)
            .unwrap_or(usize::MAX)
            .saturating_sub(self.at)
            .min(self.rest.len());
        let bytes = self.rest.as_bytes();
        while matches!(bytes.get(skip), Some(b'\n' | b'\r')) {
            skip += 1;
        }
        let (passed, rest) = self.rest.split_at_checked(skip).unwrap_or((self.rest, ""));
        self.number += line_ends(passed.as_bytes());
        self.at += passed.len();
        self.rest = rest;
        Line {
            file: self.file.to_owned(),
            number: self.number,
        }
    }
}

/// How many lines end in the text: with LF, CR LF or CR.
fn line_ends(text: &[u8]) -> usize {
    let lf = text.iter().filter(|b| **b == b'\n').count();
    let cr = text.iter().filter(|b| **b == b'\r').count();
    let crlf = text.windows(2).filter(|pair| *pair == b"\r\n").count();
    lf + cr - crlf
}

/// Where in a line the fields of a frame are.
struct Columns {
    count: usize,
    time: usize,
    /// For each landmark in chain order, its x, y and z.
    landmarks: [[usize; 3]; LANDMARKS.len()],
    phase: Option<usize>,
}

impl Columns {
    fn find(header: &StringRecord, line: &Line) -> Result<Self, CsvError> {
        let find = |column: &'static str| -> Result<Option<usize>, CsvError> {
            let mut places = header
                .iter()
                .enumerate()
                .filter(|(_, name)| *name == column)
                .map(|(i, _)| i);
            let first = places.next();
            match places.count() {
                0 => Ok(first),
                more => Err(CsvError::RepeatedColumn {
                    line: line.clone(),
                    column,
                    found: more + 1,
                }),
            }
        };
        let need = |column: &'static str| {
            find(column)?.ok_or_else(|| CsvError::MissingColumn {
                line: line.clone(),
                column,
                found: header.iter().collect::<Vec<_>>().join(","),
            })
        };
        // A name that holds others is no name.
        let separator = header.get(0).filter(|_| header.len() == 1);
        let separator = separator.and_then(|all| all.chars().find(|c| [';', '\t'].contains(c)));
        if let Some(found) = separator {
            let line = line.clone();
            return Err(CsvError::Separator { line, found });
        }
        let time = need(TIME)?;
        let mut landmarks = [[0; 3]; LANDMARKS.len()];
        for (places, (_, columns)) in landmarks.iter_mut().zip(LANDMARKS) {
            for (place, column) in places.iter_mut().zip(columns) {
                *place = need(column)?;
            }
        }
        Ok(Self {
            count: header.len(),
            time,
            landmarks,
            phase: find(PHASE)?,
        })
    }

    fn fields<'a>(
        &'a self,
        record: &'a StringRecord,
        line: &'a Line,
    ) -> Result<Fields<'a>, CsvError> {
        if record.len() == self.count {
            Ok(Fields {
                columns: self,
                record,
                line,
            })
        } else {
            Err(CsvError::FieldCount {
                line: line.clone(),
                found: record.len(),
                expected: self.count,
            })
        }
    }
}

/// A line that has as many fields as the header.
struct Fields<'a> {
    columns: &'a Columns,
    record: &'a StringRecord,
    line: &'a Line,
}

impl Fields<'_> {
    fn time(&self, before: Option<f64>) -> Result<f64, CsvError> {
        let found = self.number(self.columns.time, TIME, "a number of seconds")?;
        match before {
            Some(before) if found <= before => Err(CsvError::TimeNotIncreasing {
                line: self.line.clone(),
                found,
                before,
            }),
            _ => Ok(found),
        }
    }

    /// The landmarks' positions, which lie as near to each other as those of an arm.
    fn arm(&self) -> Result<Vec<Point>, CsvError> {
        let mut arm: Vec<Point> = Vec::with_capacity(LANDMARKS.len());
        for (places, (_, columns)) in self.columns.landmarks.iter().zip(LANDMARKS) {
            let mut point = [0.0; 3];
            for ((x, place), column) in point.iter_mut().zip(places).zip(columns) {
                *x = self.number(*place, column, "a number of metres")?;
            }
            arm.push(point);
        }
        let segments = arm.windows(2).zip(LANDMARKS.windows(2));
        for (points, landmarks) in segments {
            if let ([a, b], [(from, from_columns), (to, to_columns)]) = (points, landmarks) {
                let length = distance(*a, *b);
                if length > LONGEST_SEGMENT {
                    return Err(CsvError::NotMetres {
                        line: self.line.clone(),
                        from_column: from_columns[0],
                        to_column: to_columns[0],
                        from,
                        to,
                        length,
                    });
                }
            }
        }
        Ok(arm)
    }

    fn phase(&self, place: usize) -> Result<Phase, CsvError> {
        let expected = "a phase from 0 to 4";
        let text = self.text(place, PHASE, expected)?;
        text.parse()
            .ok()
            .and_then(Phase::from_code)
            .ok_or_else(|| CsvError::Field {
                line: self.line.clone(),
                column: PHASE,
                found: text.to_owned(),
                expected,
            })
    }

    fn number(
        &self,
        place: usize,
        column: &'static str,
        expected: &'static str,
    ) -> Result<f64, CsvError> {
        let text = self.text(place, column, expected)?;
        match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(CsvError::Field {
                line: self.line.clone(),
                column,
                found: text.to_owned(),
                expected,
            }),
        }
    }

    fn text(
        &self,
        place: usize,
        column: &'static str,
        expected: &'static str,
    ) -> Result<&str, CsvError> {
        match self.record.get(place) {
            Some(text) if !text.is_empty() => Ok(text),
            _ => Err(CsvError::Blank {
                line: self.line.clone(),
                column,
                expected,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HEADER: &str = "time,sx,sy,sz,ex,ey,ez,wx,wy,wz,hx,hy,hz,phase";
    const FIRST: &str = "0.00,0,0,0,0,0,-0.3,0,0.25,-0.3,0,0.35,-0.3,0";
    const SECOND: &str = "0.01,0,0,0,0,0,-0.3,0,0.25,-0.3,0,0.36,-0.3,1";

    fn parsed(text: impl AsRef<[u8]>) -> Result<Motion, CsvError> {
        parse(text.as_ref(), "reach.csv")
    }

    fn complaint(text: impl AsRef<[u8]>) -> String {
        parsed(text).unwrap_err().to_string()
    }

    /// A recording of two frames whose second line is replaced.
    fn with_second(line: &str) -> String {
        format!("{HEADER}\n{FIRST}\n{line}\n")
    }

    #[test]
    fn a_recording_is_read() {
        let motion = parsed(with_second(SECOND)).unwrap();
        assert_eq!(motion.name(), "reach.csv");
        assert_eq!(motion.landmarks(), ["shoulder", "elbow", "wrist", "hand"]);
        assert_eq!(motion.times(), [0.0, 0.01]);
        assert_eq!(motion.points()[1][3], [0.0, 0.36, -0.3]);
        assert_eq!(motion.phases(), Some(&[Phase::Rest, Phase::Out][..]));
    }

    #[test]
    fn columns_are_found_by_name_and_others_are_ignored() {
        let text = "hz,note,hy,hx,wz,wy,wx,ez,ey,ex,sz,sy,sx, time \n\
                    -0.3,a,0.35,0.1,-0.3,0.25,0,-0.3,0,0,0,0,0,0\n\
                    -0.3,,0.36,0.1,-0.3,0.25,0,-0.3,0,0,0,0,0,\"0.01\"\n";
        let motion = parsed(text).unwrap();
        assert_eq!(motion.points()[0][3], [0.1, 0.35, -0.3]);
        assert_eq!(motion.phases(), None);
    }

    #[test]
    fn a_byte_order_mark_blank_lines_and_any_line_ending_are_fine() {
        let plain = parsed(with_second(SECOND)).unwrap();
        for end in ["\n", "\r\n", "\r", "\n\n", "\r\n\r\n"] {
            let text = format!("\u{feff}{}", with_second(SECOND).replace('\n', end));
            assert_eq!(parsed(text).unwrap(), plain);
        }
    }

    #[test]
    fn lines_are_counted_as_an_editor_does() {
        for (end, line) in [
            ("\n", 3),
            ("\r\n", 3),
            ("\r", 3),
            ("\n\n", 5),
            ("\r\n\r\n", 5),
        ] {
            let text = with_second(&SECOND.replace("0.36", "x")).replace('\n', end);
            assert!(
                complaint(text).starts_with(&format!("reach.csv, line {line}, column \"hy\"")),
                "{end:?}"
            );
        }
    }

    #[test]
    fn a_missing_column_is_named() {
        assert_eq!(
            complaint(with_second(SECOND).replace("ez", "elbow_z")),
            "reach.csv, line 1: there is no column \"ez\", expected it among the columns found: \
             time,sx,sy,sz,ex,ey,elbow_z,wx,wy,wz,hx,hy,hz,phase"
        );
    }

    #[test]
    fn names_that_are_not_separated_by_commas_are_named() {
        for separator in [";", "\t"] {
            assert_eq!(
                complaint(with_second(SECOND).replace(',', separator)),
                format!("reach.csv, line 1: column names are separated by {separator:?}, expected commas")
                    .replace('"', "'")
            );
        }
    }

    #[test]
    fn a_column_that_is_there_twice_is_named() {
        assert_eq!(
            complaint(with_second(SECOND).replace("phase", "hx")),
            "reach.csv, line 1: there are 2 columns \"hx\", expected one"
        );
    }

    #[test]
    fn what_is_no_number_is_named_with_its_line_and_column() {
        assert_eq!(
            complaint(with_second(&SECOND.replace("0.36", "0.3.6"))),
            "reach.csv, line 3, column \"hy\": found \"0.3.6\", expected a number of metres"
        );
        assert_eq!(
            complaint(with_second(&SECOND.replace("0.01", "soon"))),
            "reach.csv, line 3, column \"time\": found \"soon\", expected a number of seconds"
        );
    }

    #[test]
    fn a_number_that_is_not_finite_is_named_with_its_line_and_column() {
        for text in ["NaN", "inf", "-Infinity", "1e999"] {
            assert_eq!(
                complaint(with_second(&SECOND.replace("0.36", text))),
                format!(
                    "reach.csv, line 3, column \"hy\": found \"{text}\", expected a number of metres"
                )
            );
        }
    }

    #[test]
    fn a_blank_cell_is_named_with_its_line_and_column() {
        assert_eq!(
            complaint(with_second(&SECOND.replace("0.36", " "))),
            "reach.csv, line 3, column \"hy\": the field is blank, expected a number of metres"
        );
        assert_eq!(
            complaint(with_second(SECOND.strip_suffix('1').unwrap())),
            "reach.csv, line 3, column \"phase\": the field is blank, expected a phase from 0 to 4"
        );
    }

    #[test]
    fn a_phase_is_0_to_4() {
        for phase in ["5", "-1", "out", "256"] {
            let line = format!("{}{phase}", SECOND.strip_suffix('1').unwrap());
            assert_eq!(
                complaint(with_second(&line)),
                format!(
                    "reach.csv, line 3, column \"phase\": found \"{phase}\", expected a phase from 0 to 4"
                )
            );
        }
    }

    #[test]
    fn a_time_that_does_not_increase_is_named_with_its_line() {
        assert_eq!(
            complaint(with_second(FIRST)),
            "reach.csv, line 3, column \"time\": found 0 s after 0 s in the frame before, expected a later time"
        );
    }

    #[test]
    fn a_line_with_another_number_of_fields_is_named() {
        assert_eq!(
            complaint(with_second("0.01,0,0")),
            "reach.csv, line 3: fields found: 3, expected 14, as many as column names"
        );
        assert_eq!(
            complaint(with_second(&format!("{SECOND},7"))),
            "reach.csv, line 3: fields found: 15, expected 14, as many as column names"
        );
    }

    #[test]
    fn millimetres_are_refused() {
        assert_eq!(
            complaint(with_second("0.01,0,0,0,0,0,-290,0,250,-290,0,340,-290,0")),
            "reach.csv, line 3, columns \"sx\" and \"ex\": found the shoulder and the elbow 290.0 apart, \
             expected less than 3: positions must be metres (are these millimetres or centimetres?)"
        );
    }

    #[test]
    fn one_frame_is_too_few() {
        assert_eq!(
            complaint(format!("{HEADER}\n{FIRST}\n")),
            "reach.csv, line 2: the file ends here, frames found: 1, expected at least 2"
        );
        assert_eq!(
            complaint(HEADER),
            "reach.csv, line 1: the file ends here, frames found: 0, expected at least 2"
        );
    }

    #[test]
    fn an_empty_file_is_said_to_be_empty() {
        for text in ["", "\u{feff}", "\r\n\n"] {
            assert_eq!(
                complaint(text),
                "reach.csv: the file is empty, expected a line of column names and a line a frame"
            );
        }
    }

    #[test]
    fn what_is_not_text_is_said_to_be_none() {
        let mut bytes = with_second(SECOND).into_bytes();
        bytes[HEADER.len() + 1 + 2] = 0xff;
        assert_eq!(
            complaint(bytes),
            "reach.csv, line 2: byte 3 of the line is not UTF-8, expected a text file of comma-separated values"
        );
    }

    #[test]
    fn coordinates_astronomically_far_away_are_no_motion() {
        let far = SECOND.replace(
            "0,0,0,0,0,-0.3,0,0.25,-0.3,0,0.36,-0.3",
            &["1e15"; 12].join(","),
        );
        assert_eq!(
            complaint(with_second(&far)),
            "reach.csv: motion \"reach.csv\", frame 1, shoulder: found 1000000000000000, \
             expected a finite number under 1e12 in size"
        );
    }

    #[test]
    fn a_file_that_cannot_be_read_is_named() {
        let error = read("no/such/reach.csv").unwrap_err().to_string();
        assert!(error.starts_with("no/such/reach.csv: cannot be read: "));
    }

    #[test]
    fn a_motion_is_written_as_recordings_are() {
        let motion = parsed(with_second(SECOND)).unwrap();
        let mut text = Vec::new();
        write(&motion, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert_eq!(text.lines().next(), Some(HEADER));
        assert_eq!(
            text.lines().nth(2),
            Some(
                "0.0100,0.0000,0.0000,0.0000,0.0000,0.0000,-0.3000,0.0000,0.2500,-0.3000,0.0000,0.3600,-0.3000,1"
            )
        );
        assert_eq!(parsed(text).unwrap(), motion);
    }

    #[test]
    fn zero_is_written_without_a_sign() {
        assert_eq!(four_decimals(-0.000_01), "0.0000");
        assert_eq!(four_decimals(-0.000_06), "-0.0001");
    }

    #[test]
    fn frames_that_four_decimals_cannot_tell_apart_are_not_written() {
        let motion = parsed(with_second(&SECOND.replace("0.01", "0.00001"))).unwrap();
        assert!(matches!(
            write(&motion, Vec::new()),
            Err(CsvError::TooDense { frame: 1, .. })
        ));
    }

    #[test]
    fn only_arms_are_written() {
        let finger = Motion::new(Recorded {
            name: "finger".into(),
            landmarks: vec!["knuckle".into(), "tip".into()],
            times: vec![0.0, 1.0],
            points: vec![vec![[0.0; 3]; 2]; 2],
            phases: None,
        })
        .unwrap();
        assert_eq!(
            write(&finger, Vec::new()).unwrap_err().to_string(),
            "motion \"finger\" has 2 landmarks, expected the 4 of an arm"
        );
    }

    proptest! {
        #[test]
        fn no_bytes_make_the_reader_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let _ = parsed(bytes);
        }

        #[test]
        fn no_damage_to_a_recording_makes_the_reader_panic(
            at in 0..170_usize,
            bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(b'\n'), Just(b','), Just(b'"'), Just(b'\r')], 0..6)
        ) {
            let mut text = with_second(SECOND).into_bytes();
            let end = (at + bytes.len()).min(text.len());
            text.splice(at.min(end)..end, bytes);
            if let Ok(motion) = parsed(&text) {
                let mut again = Vec::new();
                if write(&motion, &mut again).is_ok() {
                    prop_assert!(parsed(again).is_ok());
                }
            }
        }

        #[test]
        fn what_is_written_is_read_to_four_decimals(
            frames in prop::collection::vec(prop::array::uniform32(-0.8..0.8_f64), 2..20),
            marked: bool,
        ) {
            let motion = Motion::new(Recorded {
                name: "reach.csv".into(),
                landmarks: LANDMARKS.iter().map(|(name, _)| (*name).to_owned()).collect(),
                times: (0..frames.len()).map(|k| k as f64 / 120.0).collect(),
                points: frames.iter().map(|x| x[..12].chunks(3).map(|p| [p[0], p[1], p[2]]).collect()).collect(),
                phases: marked.then(|| vec![Phase::Back; frames.len()]),
            }).unwrap();
            let mut text = Vec::new();
            write(&motion, &mut text).unwrap();
            let again = parsed(text).unwrap();
            prop_assert_eq!(again.phases(), motion.phases());
            for (a, b) in again.times().iter().zip(motion.times()) {
                prop_assert!((a - b).abs() <= 0.5001e-4);
            }
            for (a, b) in again.points().iter().flatten().zip(motion.points().iter().flatten()) {
                prop_assert!(distance(*a, *b) <= 1e-4);
            }
        }
    }
}

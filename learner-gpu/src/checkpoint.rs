//! What is kept of a search while it runs, so that it can be stopped at any time and goes on from there.
//!
//! A [`Keeper`] says when work is to be put down, and keeps the search then. Work that the search's state says nothing of
//! before it has ended is done in pieces (`Search::pieces`): a `Journal` in the search holds those that are done, and what
//! goes on does the others.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sinew_protocol::frame::CHECK;

use crate::learn::{LearnError, Search};
use crate::output;
use crate::problem::Problem;

/// What there is is kept this often.
const EVERY: Duration = Duration::from_secs(20);

/// Where a search's state is kept while it runs, and which search it is of.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    path: PathBuf,
    /// All that the search's outcome depends on but the number of generations: with it goes how large everything is.
    identity: String,
}

/// What a checkpoint's file is found to hold.
#[derive(Clone, Debug, PartialEq)]
pub enum Kept {
    /// The search.
    Search(Box<Search>),
    /// Another search, or nothing that can be read.
    Other,
    /// There is no file.
    Nothing,
}

/// What the file holds, followed by its checksum.
#[derive(Serialize, Deserialize)]
struct File<S> {
    identity: String,
    search: S,
}

impl Checkpoint {
    /// The checkpoint of a problem in a file. `backend` is part of it: backends agree in their draws, but not in the last
    /// bits of every score.
    pub fn new(path: PathBuf, problem: &Problem, backend: &str) -> Self {
        // Debug prints every number with all its digits.
        let identity = format!("10 {backend} {problem:?}");
        Checkpoint { path, identity }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The state kept, where there is one of the same search.
    pub fn read(&self) -> Kept {
        // What is no file may have no end.
        let bytes = match std::fs::metadata(&self.path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Kept::Nothing,
            Ok(there) if there.is_file() => std::fs::read(&self.path).unwrap_or_default(),
            _ => return Kept::Other,
        };
        match postcard::from_bytes_crc32::<File<Search>>(&bytes, CHECK.digest()) {
            Ok(file) if file.identity == self.identity => Kept::Search(Box::new(file.search)),
            _ => Kept::Other,
        }
    }

    fn write(&self, search: &Search) -> Result<(), LearnError> {
        let wrong = |error| LearnError::Checkpoint {
            path: self.path.clone(),
            error,
        };
        let file = File {
            identity: self.identity.clone(),
            search,
        };
        let bytes = postcard::to_stdvec_crc32(&file, CHECK.digest())
            .map_err(|error| wrong(std::io::Error::other(error)))?;
        output::replace(&self.path, &bytes).map_err(wrong)
    }

    /// Removes it: the search is done.
    pub fn remove(&self) {
        // Where it was never written there is nothing to remove.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Who says when work is to be put down, and keeps what there is of it.
pub struct Keeper<'a> {
    /// Set once somebody wants it to stop.
    pub stop: &'a AtomicBool,
    keep: Option<Keep<'a>>,
    /// When it was last kept.
    kept: Cell<Instant>,
    /// Why it is not, where it could not be when it was last tried.
    unkept: RefCell<Option<LearnError>>,
    /// Who hears of what takes long.
    told: Option<Told<'a>>,
}

/// Who hears how it goes: what is done now, and how much of it is done of how much; of nothing, where it is a remark.
pub type Told<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

/// How a search is kept.
type Keep<'a> = Box<dyn Fn(&Search) -> Result<(), LearnError> + 'a>;

/// Of somebody whom nobody stops.
static NEVER: AtomicBool = AtomicBool::new(false);

impl Default for Keeper<'_> {
    /// One that never stops, and keeps nothing.
    fn default() -> Self {
        Keeper::new(&NEVER, None)
    }
}

impl<'a> Keeper<'a> {
    /// One that keeps a search in a checkpoint where there is one.
    pub fn new(stop: &'a AtomicBool, checkpoint: Option<&'a Checkpoint>) -> Self {
        let keep = checkpoint.map(|checkpoint| {
            let keep = |search: &Search| checkpoint.write(search);
            Box::new(keep) as Keep<'a>
        });
        Keeper {
            stop,
            keep,
            kept: Cell::new(Instant::now()),
            unkept: RefCell::new(None),
            told: None,
        }
    }

    /// The same one, but that somebody hears how it goes.
    pub fn telling<'b>(&'b self, told: Told<'b>) -> Keeper<'b> {
        Keeper {
            told: Some(told),
            ..self.within(|search| self.keep_told(search, Some(told)))
        }
    }

    /// One for a search within another: `keep` keeps the two with this one.
    pub(crate) fn within<'b>(&'b self, keep: impl Fn(&Search) + 'b) -> Keeper<'b> {
        let keep = move |inner: &Search| {
            keep(inner);
            Ok(())
        };
        Keeper {
            stop: self.stop,
            keep: match self.keep {
                Some(_) => Some(Box::new(keep)),
                None => None,
            },
            kept: self.kept.clone(),
            unkept: RefCell::new(None),
            told: self.told,
        }
    }

    /// Who hears the same as this one's, after some words.
    pub(crate) fn after(&self, words: &str) -> impl Fn(&str, usize, usize) + Sync + use<'a> {
        let (told, words) = (self.told, words.to_owned());
        move |part, done, count| {
            if let Some(told) = told {
                told(&format!("{words}: {part}"), done, count);
            }
        }
    }

    /// Whether somebody wants it to stop.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Whether work is to be put down: somebody wants it to stop, or it is to be kept. To be asked on any thread.
    pub(crate) fn is_due(&self) -> impl Fn() -> bool + Sync + use<'a> {
        let stop = self.stop;
        let due = self.keep.as_ref().map(|_| self.kept.get() + EVERY);
        move || stop.load(Ordering::Relaxed) || due.is_some_and(|due| Instant::now() >= due)
    }

    /// Keeps a search now. Where that cannot be, [`unkept`](Self::unkept) has the reason, and it is tried again in time:
    /// that it cannot be stopped is no reason for a search not to go on.
    pub fn keep(&self, search: &Search) {
        self.keep_told(search, self.told);
    }

    fn keep_told(&self, search: &Search, told: Option<Told<'_>>) {
        if let Some(keep) = &self.keep {
            let before = self.unkept.borrow().is_some();
            let unkept = keep(search).err();
            if let (Some(error), false, Some(told)) = (&unkept, before, told) {
                let words = format!("{error}: going on, but a stop would lose it");
                told(&words, 0, 0);
            }
            *self.unkept.borrow_mut() = unkept;
            self.kept.set(Instant::now());
        }
    }

    /// Why what was to be kept last is not.
    pub fn unkept(&self) -> Option<LearnError> {
        self.unkept.borrow_mut().take()
    }
}

/// Work that has not ended, as far as it is done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Journal {
    /// What the work is.
    work: String,
    /// The pieces of each of its parts.
    parts: BTreeMap<String, Vec<Piece>>,
}

/// A piece of a work.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Piece {
    is_done: bool,
    /// What has come of it, or, where it is not done, what it has begun with, if it was begun.
    bytes: Vec<u8>,
}

impl Search {
    /// Begins a work that is done in pieces, or goes on with it. Of all others nothing is kept any more.
    pub(crate) fn work(&mut self, work: String) {
        if self.journal.work != work {
            self.journal = Journal {
                work,
                ..Journal::default()
            };
        }
    }

    /// What comes of each of so many pieces of a part of the work, on all threads: those that were done before are not done
    /// again. None where it was told to stop; only then may a piece be none. Whoever hears how it goes is told the part, in
    /// words, and how many of its pieces are done.
    ///
    /// # Errors
    /// Those of the pieces.
    pub(crate) fn pieces<T: Serialize + DeserializeOwned>(
        &mut self,
        keeper: &Keeper<'_>,
        part: &str,
        count: usize,
        piece: impl Fn(usize) -> Result<Option<T>, LearnError> + Sync,
    ) -> Result<Option<Vec<T>>, LearnError> {
        self.long_pieces(keeper, part, count, |number, (): &mut ()| piece(number))
    }

    /// The same of pieces that take so long that what is begun of one is kept, too, where it was told to stop.
    pub(crate) fn long_pieces<T, B>(
        &mut self,
        keeper: &Keeper<'_>,
        part: &str,
        count: usize,
        piece: impl Fn(usize, &mut B) -> Result<Option<T>, LearnError> + Sync,
    ) -> Result<Option<Vec<T>>, LearnError>
    where
        T: Serialize + DeserializeOwned,
        B: Serialize + DeserializeOwned + Default,
    {
        let told = keeper.told;
        let tell = |done| told.map_or((), |told| told(part, done, count));
        loop {
            let is_due = keeper.is_due();
            let pieces = self.journal.parts.entry(part.to_owned()).or_default();
            pieces.resize(count, Piece::default());
            let done = AtomicUsize::new(pieces.iter().filter(|piece| piece.is_done).count());
            tell(done.load(Ordering::Relaxed));
            let left = pieces.par_iter_mut().enumerate();
            let left = left.filter(|(_, kept)| !kept.is_done);
            left.try_for_each(|(number, kept)| {
                if is_due() {
                    return Ok(());
                }
                let mut begun = match &kept.bytes[..] {
                    [] => B::default(),
                    bytes => postcard::from_bytes(bytes)?,
                };
                if let Some(found) = piece(number, &mut begun)? {
                    kept.is_done = true;
                    kept.bytes = postcard::to_stdvec(&found)?;
                    tell(done.fetch_add(1, Ordering::Relaxed) + 1);
                } else {
                    kept.bytes = postcard::to_stdvec(&begun)?;
                }
                Ok::<(), LearnError>(())
            })?;
            if pieces.iter().all(|piece| piece.is_done) {
                let found = pieces.iter();
                let found = found.map(|piece| postcard::from_bytes(&piece.bytes));
                return Ok(Some(found.collect::<Result<_, _>>()?));
            }
            keeper.keep(self);
            if keeper.stopped() {
                return Ok(None);
            }
        }
    }
}

/// Works on a search and stops it after a while, again and again until it comes to its end: with what, and how many of the
/// stops left more than there was. `took` is how long the work takes without stops; a while in which nothing was done was
/// too short, as it may be on a machine that has other work, and the next one is longer.
#[cfg(test)]
pub(crate) fn stopped_often<T>(
    search: &mut Search,
    took: Duration,
    mut work: impl FnMut(&mut Search, &AtomicBool) -> Option<T>,
) -> (T, usize) {
    let mut after = took / 100;
    let mut gains = 0;
    for _ in 0..5000 {
        let (before, stop) = (search.timeless(), AtomicBool::new(false));
        let done = std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(after);
                stop.store(true, Ordering::Relaxed);
            });
            work(search, &stop)
        });
        if let Some(done) = done {
            return (done, gains);
        }
        if search.timeless() == before {
            after += after / 10;
        } else {
            gains += 1;
        }
    }
    panic!("it comes to no end");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{ModelKind, StepperKind};

    /// One of no motions.
    fn problem() -> Problem {
        Problem::of_sample(&[], StepperKind::Transpose, ModelKind::C)
    }

    #[test]
    fn a_checkpoint_of_another_search_is_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let mut problem = problem();
        let file = folder.path().join("learning.checkpoint");
        Checkpoint::new(file.clone(), &problem, "cpu")
            .write(&Search::new(&problem))
            .unwrap();
        problem.seed += 1;
        let checkpoint = Checkpoint::new(file, &problem, "cpu");
        assert_eq!(checkpoint.read(), Kept::Other);
        checkpoint.write(&Search::new(&problem)).unwrap();
        assert!(matches!(checkpoint.read(), Kept::Search(_)));
        let whole = std::fs::read(checkpoint.path()).unwrap();
        let damaged = |bytes: &[u8]| {
            std::fs::write(checkpoint.path(), bytes).unwrap();
            assert_eq!(checkpoint.read(), Kept::Other);
        };
        for bit in (0..8 * whole.len()).step_by(997) {
            let mut bytes = whole.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            damaged(&bytes);
        }
        damaged(&whole[..whole.len() - 1]);
        damaged(b"");
        checkpoint.remove();
        assert_eq!(checkpoint.read(), Kept::Nothing);
    }

    #[test]
    fn pieces_are_done_once_and_a_stop_loses_none_that_is_done() {
        let mut search = Search::new(&problem());
        search.work("counting".to_owned());
        let done = AtomicUsize::new(0);
        let square = |k: usize| {
            done.fetch_add(1, Ordering::Relaxed);
            Ok(Some(k * k))
        };
        let mut found = None;
        let mut stops = 0;
        while found.is_none() {
            let stop = AtomicBool::new(false);
            let keeper = Keeper::new(&stop, None);
            let so_far = done.load(Ordering::Relaxed);
            let told = |part: &str, count, of| {
                assert_eq!((part, of), ("squares", 40));
                stop.store(count >= so_far + 5, Ordering::Relaxed);
            };
            let keeper = keeper.telling(&told);
            found = search.pieces(&keeper, "squares", 40, square).unwrap();
            stops += usize::from(found.is_none());
        }
        assert_eq!(found, Some((0..40).map(|k| k * k).collect()));
        assert_eq!(done.load(Ordering::Relaxed), 40);
        assert!(stops >= 2, "{stops}");

        // They are there as long as the work is the same.
        let keeper = Keeper::default();
        let again = |search: &mut Search| {
            let found = search.pieces(&keeper, "squares", 40, square);
            assert!(found.unwrap().is_some());
            done.load(Ordering::Relaxed)
        };
        search.work("counting".to_owned());
        assert_eq!(again(&mut search), 40);
        search.work("counting anew".to_owned());
        assert_eq!(again(&mut search), 80);
    }

    #[test]
    fn what_cannot_be_kept_is_told_and_stops_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("missing").join("learning.checkpoint");
        let checkpoint = Checkpoint::new(file.clone(), &problem(), "cpu");
        let keeper = Keeper::new(&NEVER, Some(&checkpoint));
        let search = Search::new(&problem());
        keeper.keep(&search);
        let told = keeper.unkept().unwrap().to_string();
        assert!(told.contains("learning.checkpoint"), "{told}");
        std::fs::create_dir(folder.path().join("missing")).unwrap();
        keeper.keep(&search);
        assert!(keeper.unkept().is_none());
        assert_eq!(checkpoint.read(), Kept::Search(Box::new(search)));
    }
}

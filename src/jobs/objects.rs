//! Results that are DICOM objects: found by what they are, and read element by element. The index has their
//! identifiers; all else is read from their files.

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use bytes::Bytes;
use futures_util::TryStreamExt;
use serde_json::Value;

use super::blocking::on_own_thread;
use super::caller::Caller;
use super::error::JobsError;
use super::service::Jobs;
use super::store::blobs::Content;
use super::store::{KeptObject, ObjectQuery, ObjectsBy};
use crate::audit::Action;
use crate::dicomweb::entries::{
    AVAILABILITY, CLASS, CONTENT, INSTANCE, INSTANCES_OF_SERIES, INSTANCES_OF_STUDY, Level, MODALITIES, MODALITY,
    SERIES, SERIES_OF_STUDY, STUDY,
};
use crate::dicomweb::json::{self, Attributes, attribute, key};
use crate::dicomweb::query::Query;
use crate::formats::Uid;
use crate::formats::dicom_elements::{DataSet, ElementsReader, Tag, WINDOW_BYTES};
use crate::formats::dicom_object::DicomObject;

/// Rows of the index that one request looks at: a few megabytes. With fewer, results of a busy tenant would be found by
/// their identifiers alone.
const MAX_ROWS: u32 = 10_000;
/// Files that one search reads. Each takes some tens of microseconds where the system has it in memory, and
/// milliseconds where a disk turns for it.
const MAX_FILES: usize = 1000;
/// Results that one search gives: some megabytes of JSON.
const MAX_RESULTS: usize = 1000;
/// Bytes of a file that a search reads. Patient, study and series stand there, whatever their length; with less, they
/// could be cut off.
const HEAD_BYTES: u64 = 32 << 10;

/// What a request names of the hierarchy: nothing, a study, a series in it, an instance in that.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectPath {
    /// Study Instance UID.
    pub study: Option<Uid>,
    /// Series Instance UID.
    pub series: Option<Uid>,
    /// SOP Instance UID.
    pub instance: Option<Uid>,
}

/// What a search found.
#[derive(Debug, Default)]
pub struct Found {
    /// Studies, series or instances, newest first.
    pub results: Vec<FoundObject>,
    /// Whether not all objects were looked at.
    pub is_cut: bool,
    /// Whether more were found than one search gives.
    pub has_more: bool,
    /// Objects whose files could not be read.
    pub unread: usize,
}

/// A study, a series or an instance.
#[derive(Debug)]
pub struct FoundObject {
    /// Its newest instance.
    pub object: DicomObject,
    /// The attributes of that, and those that count the others.
    pub attributes: Attributes,
}

/// Identifiers that are looked for, each `None` where any will do.
struct Wanted {
    studies: Option<Vec<String>>,
    series: Option<Vec<String>>,
    instances: Option<Vec<String>>,
    classes: Option<Vec<String>>,
}

impl Wanted {
    /// What a path and the keys of a query ask for together.
    fn of(path: &ObjectPath, query: Option<&Query>) -> Self {
        let both = |given: Option<&Uid>, tag| {
            let keys = query.and_then(|query| query.uids(tag));
            match (given.map(Uid::as_str), keys) {
                (None, keys) => keys.map(<[String]>::to_vec),
                (Some(given), Some(keys)) if !keys.iter().any(|key| key == given) => Some(Vec::new()),
                (Some(given), _) => Some(vec![given.to_owned()]),
            }
        };
        Self {
            studies: both(path.study.as_ref(), STUDY),
            series: both(path.series.as_ref(), SERIES),
            instances: both(path.instance.as_ref(), INSTANCE),
            classes: both(None, CLASS),
        }
    }

    /// Looks into the index that lead to all that is wanted: by the narrowest identifiers.
    fn looks(&self) -> Vec<ObjectsBy> {
        let by = |uids: &[String], by: fn(String) -> ObjectsBy| uids.iter().cloned().map(by).collect();
        match self {
            Self { instances: Some(uids), .. } => by(uids, ObjectsBy::Instance),
            Self { series: Some(uids), .. } => by(uids, ObjectsBy::Series),
            Self { studies: Some(uids), .. } => by(uids, ObjectsBy::Study),
            _ => vec![ObjectsBy::Any],
        }
    }

    fn fits(&self, object: &DicomObject) -> bool {
        let is_in = |uids: &Option<Vec<String>>, uid: &String| uids.as_ref().is_none_or(|uids| uids.contains(uid));
        is_in(&self.studies, &object.study)
            && is_in(&self.series, &object.series)
            && is_in(&self.instances, &object.instance)
            && is_in(&self.classes, &object.class)
    }
}

impl Jobs {
    /// Searches the caller's DICOM results, newest first.
    ///
    /// # Errors
    /// When the store fails.
    pub async fn search(&self, caller: &Caller, path: &ObjectPath, query: &Query) -> Result<Found, JobsError> {
        // One after the other for each tenant: they read many files.
        let own = self.searches().of(&caller.tenant);
        let _turn = own.lock().await;
        let (objects, is_cut) = self.find(caller, &Wanted::of(path, Some(query))).await?;
        let mut found = Found { is_cut, ..Found::default() };
        let (mut files, mut passed) = (0, 0);
        let given = path.series.as_ref().map(|_| Level::Series).or(path.study.as_ref().map(|_| Level::Study));
        for group in groups(objects, query.level()) {
            let is_full = found.results.len() >= query.limit.unwrap_or(MAX_RESULTS).min(MAX_RESULTS);
            if is_full {
                found.has_more = query.limit.is_none_or(|limit| limit > MAX_RESULTS);
                break;
            }
            if passed < query.offset && query.is_of_uids_alone() {
                passed += 1;
                continue;
            }
            let (needed, room) = (if query.level() == Level::Study { group.len() } else { 1 }, MAX_FILES - files);
            found.is_cut |= needed > room;
            if room == 0 {
                break;
            }
            files += needed.min(room);
            let Some(result) = self.read_group(&group, (query.level(), room), &mut found.unread).await else {
                continue;
            };
            if !query.fits(&result.attributes) {
                continue;
            }
            if passed < query.offset {
                passed += 1;
                continue;
            }
            // Only what is told is kept: a thousand whole ones would fill the memory.
            found.results.push(FoundObject { attributes: query.select(result.attributes, given), ..result });
        }
        let outcome = if found.results.is_empty() { "nothing" } else { "found" };
        self.record(caller, Action::Search, None, outcome).await;
        Ok(found)
    }

    /// The caller's DICOM results that a path names, newest first; each once, however many jobs have it. And whether
    /// there are more than are looked at.
    ///
    /// # Errors
    /// When the store fails.
    pub async fn objects(&self, caller: &Caller, path: &ObjectPath) -> Result<(Vec<KeptObject>, bool), JobsError> {
        self.find(caller, &Wanted::of(path, None)).await
    }

    /// Looks into the index.
    async fn find(&self, caller: &Caller, wanted: &Wanted) -> Result<(Vec<KeptObject>, bool), JobsError> {
        let (mut found, mut left) = (Vec::new(), MAX_ROWS + 1);
        for by in wanted.looks() {
            let query = ObjectQuery { owner: caller.tenant.clone(), by, limit: left };
            let some = self.store().find_objects(&query).await?;
            left = left.saturating_sub(u32::try_from(some.len()).unwrap_or(u32::MAX));
            found.extend(some);
            if left == 0 {
                found.pop();
                break;
            }
        }
        // Those of several looks are each in order.
        found.sort_by_key(|object| std::cmp::Reverse(object.id));
        let mut known = BTreeSet::new();
        found.retain(|kept| wanted.fits(&kept.object) && known.insert(kept.object.instance.clone()));
        Ok((found, left == 0))
    }

    /// What the files of a study, a series or an instance say, `room` of them at the most; `None` where none can be
    /// read.
    async fn read_group(
        &self,
        group: &[KeptObject],
        (level, room): (Level, usize),
        unread: &mut usize,
    ) -> Option<FoundObject> {
        let mut read: Option<FoundObject> = None;
        let mut modalities = BTreeSet::new();
        for kept in group.iter().take(room) {
            // One that can be read says all of a series.
            if read.is_some() && level != Level::Study {
                break;
            }
            let attributes = match self.read_head(kept).await {
                Ok(attributes) => attributes,
                Err(error) => {
                    // Where a disk fails, there may be a thousand.
                    if *unread == 0 {
                        tracing::warn!(job = %kept.id, name = kept.file.name, %error, "a result cannot be searched");
                    }
                    *unread += 1;
                    continue;
                }
            };
            modalities
                .extend(attributes.get(&key(MODALITY)).and_then(|own| own["Value"][0].as_str().map(str::to_owned)));
            if read.is_none() {
                read = Some(FoundObject { object: kept.object.clone(), attributes });
            }
        }
        let mut read = read?;
        add_counts(&mut read.attributes, group, level);
        if level == Level::Study {
            let modalities = modalities.into_iter().map(Value::from).collect();
            read.attributes.insert(key(MODALITIES), attribute("CS", modalities));
        }
        Some(read)
    }

    /// What stands at the begin of an object. Fails also where it was erased in this moment.
    async fn read_head(&self, kept: &KeptObject) -> io::Result<Attributes> {
        let mut reader = ElementsReader::default();
        let window = self.window(kept, (0, kept.file.bytes.min(HEAD_BYTES))).await?;
        reader.take(&window).map_err(io::Error::other)?;
        let mut attributes = json::attributes(&reader.finish(), None);
        // What a report tells is no attribute that is searched, and most of it.
        attributes.remove(&key(CONTENT));
        // The file was not compared with its hash.
        let is_it = attributes.get(&key(INSTANCE)).is_some_and(|own| own["Value"][0] == kept.object.instance.as_str());
        if is_it { Ok(attributes) } else { Err(io::ErrorKind::InvalidData.into()) }
    }

    /// All elements of an object, once its file was found to be what was kept.
    ///
    /// # Errors
    /// When it is not, or is gone.
    pub async fn data_set(&self, kept: &KeptObject) -> Result<DataSet, JobsError> {
        let content = self.content(kept.id, &kept.token, &kept.file).await?;
        let mut reader = ElementsReader::default();
        while reader.position() < kept.file.bytes {
            let (first, end) = (reader.position(), kept.file.bytes.min(reader.position() + WINDOW_BYTES));
            let window = match &content {
                Content::Bytes(bytes, _) => part_of(bytes, (first, end)),
                Content::Stored => self.window(kept, (first, end)).await?,
            };
            let taken = on_own_thread(move || Ok(reader.take(&window).map(|()| reader))).await?;
            reader = taken.map_err(|error| {
                tracing::error!(job = %kept.id, name = kept.file.name, %error, "a result is no object of this program");
                JobsError::ResultDamaged
            })?;
        }
        Ok(reader.finish())
    }

    async fn window(&self, kept: &KeptObject, range: (u64, u64)) -> io::Result<Bytes> {
        let chunks = self.blobs().read_range((kept.id, &kept.token, &kept.file.name), range).await?;
        let bytes: Vec<Bytes> = chunks.try_collect().await?;
        Ok(bytes.concat().into())
    }
}

fn part_of(bytes: &Bytes, (first, end): (u64, u64)) -> Bytes {
    let at = |place: u64| usize::try_from(place).unwrap_or(usize::MAX).min(bytes.len());
    bytes.slice(at(first)..at(end))
}

/// Objects of one study, series or instance together, in the order of their first ones.
fn groups(objects: Vec<KeptObject>, level: Level) -> Vec<Vec<KeptObject>> {
    let mut groups: Vec<Vec<KeptObject>> = Vec::new();
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    for kept in objects {
        let name = match level {
            Level::Study => kept.object.study.clone(),
            Level::Series => format!("{} {}", kept.object.study, kept.object.series),
            Level::Instance => kept.object.instance.clone(),
        };
        let place = *places.entry(name).or_insert(groups.len());
        match groups.get_mut(place) {
            Some(group) => group.push(kept),
            None => groups.push(vec![kept]),
        }
    }
    groups
}

fn add_counts(attributes: &mut Attributes, group: &[KeptObject], level: Level) {
    let mut add = |tag: Tag, kind: &str, value: Value| {
        attributes.insert(key(tag), attribute(kind, vec![value]));
    };
    add(AVAILABILITY, "CS", "ONLINE".into());
    match level {
        Level::Study => {
            let series: BTreeSet<&str> = group.iter().map(|kept| kept.object.series.as_str()).collect();
            add(SERIES_OF_STUDY, "IS", series.len().into());
            add(INSTANCES_OF_STUDY, "IS", group.len().into());
        }
        Level::Series => add(INSTANCES_OF_SERIES, "IS", group.len().into()),
        Level::Instance => {}
    }
}

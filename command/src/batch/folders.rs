//! Folders of jobs: written aside, forced to disk, then renamed.

use super::hashes::{HashedFile, hash_file};
use super::names::FOLDER;
use mrvis::{Error, Result};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// The folder that a job writes into until it is done.
pub fn work(out: &Path, name: &str) -> PathBuf {
    out.join(FOLDER).join("work").join(name)
}

/// Removes a folder with all it holds, if it exists.
///
/// # Errors
/// [`Error::Io`].
pub fn remove(folder: &Path) -> Result<()> {
    match fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(folder, e)),
        _ => Ok(()),
    }
}

/// Makes the empty folder that a job writes into.
///
/// # Errors
/// [`Error::Io`].
pub fn begin(out: &Path, name: &str) -> Result<()> {
    let folder = work(out, name);
    remove(&folder)?;
    fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))
}

/// Forces the work folder of a job to disk with all its files; returns them in alphabetic order.
///
/// # Errors
/// [`Error::Io`].
pub fn seal(out: &Path, name: &str) -> Result<Vec<HashedFile>> {
    let (mut files, folder) = (Vec::new(), work(out, name));
    seal_below(&folder, Path::new(""), &mut files)?;
    sync_up(&folder, &out.join(FOLDER))?;
    files.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(files)
}

fn seal_below(folder: &Path, relative: &Path, files: &mut Vec<HashedFile>) -> Result<()> {
    let at = |e| Error::io(folder, e);
    for entry in fs::read_dir(folder).map_err(at)? {
        let entry = entry.map_err(at)?;
        let (path, name) = (entry.path(), relative.join(entry.file_name()));
        if entry.file_type().map_err(at)?.is_dir() {
            seal_below(&path, &name, files)?;
            continue;
        }
        let file = File::open(&path).map_err(|e| Error::io(&path, e))?;
        file.sync_all().map_err(|e| Error::io(&path, e))?;
        let about = file.metadata().map_err(|e| Error::io(&path, e))?;
        let (bytes, changed) = (about.len(), changed(&about));
        files.push(HashedFile { path: name, bytes, blake3: hash_file(&path)?, changed });
    }
    sync_folder(folder)
}

/// See [`HashedFile::changed`]; nothing on systems without such a time.
fn changed(about: &fs::Metadata) -> Option<i64> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        about.ctime().checked_mul(1_000_000_000)?.checked_add(about.ctime_nsec())
    }
    #[cfg(not(unix))]
    {
        let _ = about;
        None
    }
}

/// Forces the names in a folder to disk.
fn sync_folder(folder: &Path) -> Result<()> {
    // Other systems cannot open folders.
    #[cfg(unix)]
    File::open(folder).and_then(|f| f.sync_all()).map_err(|e| Error::io(folder, e))?;
    Ok(())
}

/// Forces the name of a file or folder to disk, and those of all folders from there up to `out`, which it lies in.
///
/// # Errors
/// [`Error::Io`].
pub fn sync_up(path: &Path, out: &Path) -> Result<()> {
    path.ancestors().skip(1).take_while(|folder| folder.starts_with(out)).try_for_each(sync_folder)
}

/// Moves the folder of a job out of the results in one step, into a folder that is returned and that the caller then removes.
///
/// # Errors
/// [`Error::Io`].
pub fn withdraw(out: &Path, name: &str) -> Result<PathBuf> {
    let (folder, former) = (out.join(name), out.join(FOLDER).join("former").join(name));
    if folder.symlink_metadata().is_ok() {
        remove(&former)?;
        let moved =
            fs::create_dir_all(former.parent().unwrap_or(out)).and_then(|()| fs::rename(&folder, &former));
        moved.map_err(|e| Error::io(&folder, e))?;
    }
    Ok(former)
}

/// Gives the finished folder of a job its place. A former one is moved away first and removed afterwards. A renaming that a failure of
/// power undoes is repeated by the next run.
///
/// # Errors
/// [`Error::Io`].
pub fn publish(out: &Path, name: &str) -> Result<()> {
    let (from, to) = (work(out, name), out.join(name));
    let former = withdraw(out, name)?;
    let placed = fs::create_dir_all(to.parent().unwrap_or(out)).and_then(|()| fs::rename(&from, &to));
    placed.map_err(|e| Error::io(&to, e))?;
    // What cannot be removed takes space, nothing else; the next withdrawal tries again.
    let _ = remove(&former);
    Ok(())
}

/// Checks that the outputs of a job are in their place as the batch made them. Those that a crash has left in the work folder, complete,
/// are given it if `may_publish`.
///
/// # Errors
/// What is wrong with them, as `view.png is missing`.
pub fn publish_left(out: &Path, name: &str, outputs: &[HashedFile], may_publish: bool) -> Result<(), String> {
    if check_outputs(&work(out, name), outputs).is_err() {
        return check_outputs(&out.join(name), outputs);
    }
    let published = match may_publish {
        true => publish(out, name).and_then(|()| sync_up(&out.join(name), out)),
        false => Ok(()),
    };
    published.map_err(|e| e.to_string())
}

/// Checks that a folder holds these files with their content. Where neither size nor [`HashedFile::changed`] differ a file is not read.
///
/// # Errors
/// What is wrong with the first that differs, as `view.png is missing`.
pub fn check_outputs(folder: &Path, files: &[HashedFile]) -> Result<(), String> {
    if !folder.is_dir() {
        return Err("its folder is missing".into());
    }
    files.iter().try_for_each(|file| {
        let path = folder.join(&file.path);
        let Ok(about) = fs::metadata(&path) else {
            return Err(format!("{} is missing", file.path.display()));
        };
        let is_untouched = || file.changed.is_some() && file.changed == changed(&about);
        let is_same = || is_untouched() || hash_file(&path).is_ok_and(|hash| hash == file.blake3);
        match about.len() == file.bytes && is_same() {
            true => Ok(()),
            false => Err(format!("{} was changed since the batch made it", file.path.display())),
        }
    })
}

/// Takes a lock of an output folder, made if it is missing; it is released when the file is closed, also by a crash. Several may hold a
/// shared one.
///
/// # Errors
/// Another batch holds it, or the folder cannot be written.
pub fn lock(out: &Path, name: &str, shared: bool) -> Result<File> {
    let what = "another batch is writing into this folder; wait for its end or choose another folder";
    try_lock(out, name, shared)?.ok_or_else(|| Error::format(out, None, what))
}

/// Takes a lock of an output folder as soon as others have released it: they hold it for moments only.
///
/// # Errors
/// The folder cannot be written.
pub fn wait_for_lock(out: &Path, name: &str) -> Result<File> {
    let (path, file) = lock_file(out, name)?;
    file.lock().map_err(|e| Error::io(path, e))?;
    Ok(file)
}

/// Takes a lock, unless others hold it.
fn try_lock(out: &Path, name: &str, shared: bool) -> Result<Option<File>> {
    let (path, file) = lock_file(out, name)?;
    match if shared { file.try_lock_shared() } else { file.try_lock() } {
        Ok(()) => Ok(Some(file)),
        Err(fs::TryLockError::WouldBlock) => Ok(None),
        Err(fs::TryLockError::Error(e)) => Err(Error::io(path, e)),
    }
}

/// The file of a lock, made if it is missing.
fn lock_file(out: &Path, name: &str) -> Result<(PathBuf, File)> {
    let folder = out.join(FOLDER);
    fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
    let path = folder.join(name);
    let mut options = File::options();
    let file = options.create(true).truncate(false).write(true).open(&path);
    let file = file.map_err(|e| Error::io(&path, e))?;
    Ok((path, file))
}

/// Takes a lock for a part of a split into `of` parts. Parts of one split have different jobs; those of two splits would run the same.
///
/// # Errors
/// Parts of another split run in this folder, or it cannot be written.
pub fn lock_split(out: &Path, of: usize) -> Result<File> {
    const PREFIX: &str = "split-into-";
    let own = format!("{PREFIX}{of}");
    // To look for parts of another split is to take their lock for a moment: two parts that look at the same time would find each other.
    let _check = wait_for_lock(out, "check-of-splits")?;
    let held = lock(out, &own, true)?;
    let folder = out.join(FOLDER);
    let at = |e| Error::io(&folder, e);
    for entry in fs::read_dir(&folder).map_err(at)? {
        let name = entry.map_err(at)?.file_name().to_string_lossy().into_owned();
        if name.starts_with(PREFIX) && name != own && try_lock(out, &name, false)?.is_none() {
            let what = format!(
                "parts of another split are running in this folder ({name}); wait for their end, or write the part of {of} into another folder"
            );
            return Err(Error::format(out, None, what));
        }
    }
    Ok(held)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_appears_whole_and_replaces_the_former() {
        let out = tempfile::tempdir().expect("a folder");
        for text in ["one", "three"] {
            begin(out.path(), "a/b").expect("made");
            fs::create_dir(work(out.path(), "a/b").join("sub")).expect("made");
            fs::write(work(out.path(), "a/b").join("sub/x"), text).expect("written");
            let files = seal(out.path(), "a/b").expect("sealed");
            assert_eq!((files.len(), files[0].bytes), (1, text.len() as u64));
            assert!(check_outputs(&out.path().join("a/b"), &files).is_err());
            // A crash has left it there.
            let place = |may_publish| publish_left(out.path(), "a/b", &files, may_publish).is_ok();
            assert!(place(false) && work(out.path(), "a/b").exists());
            assert!(place(true) && place(true));
            check_outputs(&out.path().join("a/b"), &files).expect("all are there");
            assert!(!work(out.path(), "a/b").exists());
        }
        let former = withdraw(out.path(), "a/b").expect("moved");
        assert!(!out.path().join("a/b").exists() && former.join("sub/x").exists());
        remove(&former).expect("removed");
        remove(&withdraw(out.path(), "a/b").expect("nothing")).expect("nothing");
    }

    #[test]
    fn changed_outputs_are_told_from_copied_ones() {
        let out = tempfile::tempdir().expect("a folder");
        begin(out.path(), "a").expect("made");
        let file = work(out.path(), "a").join("x");
        fs::write(&file, "one").expect("written");
        let files = seal(out.path(), "a").expect("sealed");
        publish(out.path(), "a").expect("published");
        let (file, check) = (out.path().join("a/x"), || check_outputs(&out.path().join("a"), &files));
        check().expect("as made");
        // Another time, the same content: a copy.
        let copy = out.path().join("copy");
        fs::copy(&file, &copy).expect("copied");
        fs::rename(&copy, &file).expect("renamed");
        check().expect("as made");
        // The same size and the same time of modification: an altered result. Times of files have steps of some milliseconds.
        std::thread::sleep(std::time::Duration::from_millis(30));
        let modified = fs::metadata(&file).and_then(|about| about.modified()).expect("a time");
        fs::write(&file, "two").expect("written");
        File::options().write(true).open(&file).and_then(|f| f.set_modified(modified)).expect("set");
        assert_eq!(check(), Err("x was changed since the batch made it".into()));
        fs::remove_file(&file).expect("removed");
        assert_eq!(check(), Err("x is missing".into()));
    }

    #[test]
    fn one_batch_has_the_lock() {
        let out = tempfile::tempdir().expect("a folder");
        let held = lock(out.path(), "lock", false).expect("locked");
        assert!(lock(out.path(), "lock", false).expect_err("refused").to_string().contains("another batch"));
        drop(held);
        let parts = [true, true].map(|shared| lock(out.path(), "lock", shared).expect("shared"));
        assert!(lock(out.path(), "lock", false).is_err());
        drop(parts);
        lock(out.path(), "lock", false).expect("locked again");
    }

    #[test]
    fn parts_start_at_the_same_time_beside_locks_of_former_splits() {
        let out = tempfile::tempdir().expect("a folder");
        for of in 3..40 {
            drop(lock_split(out.path(), of).expect("no others"));
        }
        std::thread::scope(|scope| {
            let starts = || (0..50).try_for_each(|_| lock_split(out.path(), 2).map(drop));
            let parts = [(); 4].map(|()| scope.spawn(starts));
            for part in parts {
                part.join().expect("no panic").expect("one split");
            }
        });
    }
}

//! Job files: sweeps, names, dependencies, and errors with their places.

use super::*;
use mrvis::Result;

/// The jobs of a text beside the files `rooms/a.obj` and `rooms/b.obj`.
fn jobs(text: &str) -> Result<Vec<Job>> {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(folder.path().join("rooms")).expect("made");
    for name in ["rooms/b.obj", "rooms/a.obj"] {
        std::fs::write(folder.path().join(name), "").expect("written");
    }
    let source = TomlSource { path: folder.path().join("jobs.toml"), text: text.into() };
    let mut jobs = expand(&source, &parse(&source)?)?;
    check(&source, &mut jobs)?;
    Ok(jobs)
}

fn names(text: &str) -> Vec<String> {
    jobs(text).expect("jobs").into_iter().map(|job| job.name).collect()
}

/// The error, from the name of the file on.
fn refused(text: &str) -> String {
    let error = jobs(text).expect_err("refused").to_string();
    error[error.find("jobs.toml").expect("the file")..].to_owned()
}

const SOLVE: &str = "[[job]]\ncommand = 'solve'\nscene = 'rooms/a.obj'\n";

#[test]
fn sweeps_are_grids_of_lists_beside_zipped_ones() {
    let text = "[[job]]\ncommand = 'solve'\nscene = 'rooms/*.obj'\nname = '{scene}/e{error}-{seed}{max-links}'\n\
                [job.sweep]\nerror = [0.1, 0.05]\n[job.zip]\nseed = [1, 2]\nmax-links = [10, 20]\n";
    let want = ["a/e0.1-110", "a/e0.05-110", "a/e0.1-220", "a/e0.05-220"];
    let found = names(text);
    assert_eq!(found[..4], want);
    assert_eq!(found.len(), 8);
    assert_eq!(found[4], "b/e0.1-110");
}

#[test]
fn names_have_the_swept_options_by_default() {
    let text = format!("{SOLVE}[job.sweep]\nerror = [0.1, 0.05]\nemitter = [['a=1W', 'b=2W'], false]\n");
    let want = ["solve-a-error=0.1-emitter=a=1W,b=2W", "solve-a-error=0.1-emitter=false"];
    assert_eq!(names(&text)[..2], want);
}

#[test]
fn ranges_are_linear_or_logarithmic() {
    let values = |range: &str| -> Vec<String> {
        let found = jobs(&format!("{SOLVE}[job.sweep]\nerror = {range}\n")).expect("jobs");
        found.iter().map(|job| job.option("error").expect("swept").shown()).collect()
    };
    assert_eq!(values("{ from = 0.1, to = 0.8, steps = 4, scale = 'log' }"), ["0.1", "0.2", "0.4", "0.8"]);
    assert_eq!(values("{ from = 1, to = 2, steps = 3 }"), ["1", "1.5", "2"]);
    assert_eq!(values("{ from = 0.1, to = 0.4, by = 0.1 }"), ["0.1", "0.2", "0.3", "0.4"]);
    assert_eq!(values("{ from = 3, to = 1, by = -1 }"), ["3", "2", "1"]);
}

#[test]
fn own_options_replace_the_defaults() {
    let text = format!(
        "[defaults]\noptions = {{ seed = 3, error = 0.2 }}\nlimits = {{ seconds = 5, memory = '2G' }}\nretry = 2\n\
         {SOLVE}options = {{ error = 0.1, time = 2026-06-21T10:00:00+02:00 }}\nlimits = {{ seconds = 7 }}\n"
    );
    let job = jobs(&text).expect("a job").remove(0);
    assert_eq!(job.option("seed"), Some(&Value::Text("3".into())));
    assert_eq!(job.options.iter().filter(|o| o.name == "error").count(), 1);
    assert_eq!(job.option("error"), Some(&Value::Text("0.1".into())));
    assert_eq!(job.option("time"), Some(&Value::Text("2026-06-21T10:00:00+02:00".into())));
    assert_eq!(job.limits, Limits { seconds: Some(7.0), memory: Some(2 << 30) });
    assert_eq!(job.retry, 2);
}

#[test]
fn dependencies_are_names_tags_or_outputs() {
    let text = "[[job]]\ncommand = 'reference'\nscene = 'rooms/*.obj'\nname = 'ref-{scene}'\ntags = ['night']\n\
                [[job]]\ncommand = 'compare'\nname = 'c-{tolerance}'\ninputs = ['{out:ref-a}/i.csv', '{out:ref-b}/i.csv']\n\
                [job.sweep]\ntolerance = [0.1]\n\
                [[job]]\ncommand = 'info'\nscene = '{out:c-0.1}/x.obj'\nname = 'last'\nafter = 'night'\n";
    let found = jobs(text).expect("jobs");
    assert_eq!(found[2].needs, [0, 1]);
    assert_eq!(found[3].needs, [0, 1, 2]);
    assert_eq!(order(&found), [0, 1, 2, 3]);
    let resolved = resolve_outputs(&found[2].inputs[0], |name| format!("out/{name}"));
    assert_eq!(resolved, "out/ref-a/i.csv");
}

#[test]
fn values_for_templates_are_no_options() {
    let text = "[[job]]\ncommand = 'reference'\nscene = 'rooms/a.obj'\nname = 'ref-{seed}'\n[job.sweep]\nseed = [1, 2]\n\
                [[job]]\ncommand = 'compare'\nname = 'c{run}'\ninputs = ['{out:ref-{run}}/i.csv', 'rooms/a.obj']\n\
                [job.each]\nrun = [1, 2]\n";
    let found = jobs(text).expect("jobs");
    assert_eq!(found.iter().map(|job| job.name.as_str()).collect::<Vec<_>>(), ["ref-1", "ref-2", "c1", "c2"]);
    assert!(found[2].options.is_empty());
    assert_eq!([&found[2].needs, &found[3].needs], [&[0], &[1]]);
    // An option of the same name stays.
    let kept = jobs(&format!("{SOLVE}options = {{ seed = 3 }}\n[job.each]\nseed = [1, 2]\n")).expect("jobs");
    assert!(kept.len() == 2 && kept.iter().all(|job| job.options.iter().any(|o| o.name == "seed")));
}

#[test]
fn errors_name_line_column_and_cure() {
    let solve = |rest: &str| refused(&format!("{SOLVE}{rest}"));
    for (found, want) in [
        (refused("[[job]\n"), "jobs.toml:1:"),
        (refused(""), "jobs.toml:1:1: there are no jobs"),
        (refused("[[jobs]]\n"), "jobs.toml:1:3: unknown key `jobs`; did you mean `job`?"),
        (refused("[[job]]\nscene = 'rooms/a.obj'\n"), "jobs.toml:1:1: the job has no `command`"),
        (refused("[[job]]\ncommand = 'slove'\n"), "jobs.toml:2:11: unknown command `slove`"),
        (refused("[[job]]\ncommand = 'solve'\n"), "jobs.toml:1:1: `solve` needs `scene`"),
        (refused("[[job]]\ncommand = 'compare'\ninputs = ['a']\n"), "needs 2 in `inputs`, 1 are given"),
        (solve("sweeep = 1\n"), "jobs.toml:4:1: unknown key `sweeep`; did you mean `sweep`?"),
        (solve("limits = { second = 3 }"), "jobs.toml:4:12: unknown key `second`; did you mean `seconds`?"),
        (solve("limits = { memory = '4X' }"), "jobs.toml:4:21: must be text such as"),
        (solve("limits = { seconds = -1 }"), "above 0"),
        (solve("retry = -1"), "jobs.toml:4:9: must be a whole number"),
        (solve("[job.sweep]\nerror = { from = 0, to = 1, steps = 3, scale = 'log' }"), "lies above 0"),
        (solve("[job.sweep]\nerror = { from = 0, to = 1 }"), "needs `steps`"),
        (solve("[job.sweep]\nerror = { from = 0, to = 1, by = 0 }"), "does not lead"),
        (solve("[job.sweep]\nerror = []"), "no values"),
        (solve("[job.zip]\nerror = [1, 2]\nseed = [1]"), "jobs.toml:6:1: lists of `zip` have one length"),
        (
            solve("name = '{eror}'\noptions = { error = 1 }"),
            "jobs.toml:4:8: `{eror}` is no value of this job; did",
        ),
        (solve("name = '{scene'"), "brace without its partner"),
        (solve("name = '../x'"), "leaves the output folder"),
        (solve("name = '/x'"), "leaves the output folder"),
        (solve("name = 'results.csv'"), "of the batch itself"),
        (solve("name = '.mrvis-batch/work'"), "of the batch itself"),
        (solve("name = 'x'\n[job.sweep]\nerror = [1, 2]"), "jobs.toml:4:8: two jobs have the folder `x`"),
        (solve("name = 'x'\n[[job]]\ncommand = 'info'\nscene = 'rooms/b.obj'\nname = 'x/y'"), "lies in that"),
        (
            solve("after = 'slove-a'"),
            "jobs.toml:4:9: `slove-a` is no name or tag of a job; did you mean `solve-a`?",
        ),
        (solve("options = { points = '{out:x}/p.csv' }"), "is the output of no job"),
        (solve("after = 'solve-a'"), "wait for each other: solve-a -> solve-a"),
        (
            solve(
                "after = 'b'\n[[job]]\ncommand = 'info'\nscene = 'rooms/b.obj'\nname = 'b'\nafter = 'solve-a'",
            ),
            "wait",
        ),
        (
            refused("[[job]]\ncommand = 'info'\nscene = 'missing.obj'\n"),
            "jobs.toml:3:9: the scene `missing.obj` cannot",
        ),
        (refused("[[job]]\ncommand = 'info'\nscene = 'x*.obj'\n"), "no file matches"),
    ] {
        assert!(found.contains(want), "{found}\nlacks {want}");
    }
}

#[test]
fn sweeps_beyond_all_memory_are_refused() {
    let axis = |k: usize| format!("o{k} = {{ from = 1, to = 9, steps = 1000 }}\n");
    let text = format!("{SOLVE}[job.sweep]\n{}", (0..6).map(axis).collect::<String>());
    assert!(refused(&text).contains("more than 1000000 jobs"));
    assert_eq!(suggestion("feature", ["scene", "features"]), "; did you mean `features`?");
}

/// The JSON Schema for editors knows the keys and commands that the parser knows.
#[test]
fn the_schema_has_the_keys_of_the_parser() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/batch.schema.json");
    let text = std::fs::read_to_string(path).expect("the schema");
    let schema: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let keys = |place: &str| -> Vec<String> {
        let object = schema.pointer(place).and_then(|v| v["properties"].as_object()).expect("properties");
        object.keys().cloned().collect()
    };
    let sorted = |known: &[&str]| -> Vec<String> {
        let mut names: Vec<String> = known.iter().map(|name| name.to_string()).collect();
        names.sort();
        names
    };
    use super::job::{AXIS_KEYS, DEFAULT_KEYS, FILE_KEYS, JOB_KEYS, LIMIT_KEYS};
    assert_eq!(keys(""), sorted(&FILE_KEYS));
    assert_eq!(keys("/properties/defaults"), sorted(&DEFAULT_KEYS));
    assert_eq!(keys("/$defs/job"), sorted(&JOB_KEYS));
    assert_eq!(keys("/$defs/limits"), sorted(&LIMIT_KEYS));
    assert_eq!(keys("/$defs/axis/anyOf/1"), sorted(&AXIS_KEYS));
    let commands = schema.pointer("/$defs/job/properties/command/enum").expect("commands");
    assert_eq!(commands, &serde_json::json!(COMMANDS.map(|c| c.name)));
}

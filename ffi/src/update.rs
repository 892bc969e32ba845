//! Instances of a model, and changes of them.

use super::arguments::{c_text, check_pointer, count_of, no_reserved, nth, optional_text, wrong};
use super::entry::entry;
use super::guard::Outcome;
use super::model::{NamedModel, mrv_model};
use super::record::{read_entry, record};
use mrvis::{Instance, InstanceChange};
use std::ffi::c_char;

pub const MRV_MATERIAL_KEEP: i32 = -1;

record!(136: struct mrv_instance {
    struct_size: usize,
    name: *const c_char,
    transform: [f64; 12],
    material: i64,
    mesh: u32,
    visible: i32,
    removed: i32,
    reserved: u32,
});

entry!(mrv_model_get_instance(call, model: Handle<mrv_model>, index: u64) -> instance: RecordPlace<mrv_instance> {
    let all = model.model.instances();
    let found = nth(all, index, "the model", "instances")?;
    let names = model.names.get_or_init(|| all.iter().map(|instance| c_text(&instance.name)).collect());
    mrv_instance {
        struct_size: 0,
        name: names[count_of(index)].as_ptr(),
        transform: std::array::from_fn(|i| found.transform[i / 4][i % 4]),
        material: found.material.map_or(i64::from(MRV_MATERIAL_KEEP), i64::from),
        mesh: found.mesh,
        visible: i32::from(found.visible),
        removed: i32::from(found.removed),
        reserved: 0,
    }
});

pub const MRV_CHANGE_MOVE: i32 = 1;
pub const MRV_CHANGE_ADD: i32 = 2;
pub const MRV_CHANGE_REMOVE: i32 = 3;
pub const MRV_CHANGE_SHOW: i32 = 4;
pub const MRV_CHANGE_HIDE: i32 = 5;

record!(136: struct mrv_instance_change {
    struct_size: usize,
    kind: i32,
    instance: u32,
    transform: [f64; 12],
    name: *const c_char,
    material: i64,
    mesh: u32,
    reserved: u32,
});

entry!(mrv_model_update(
    call, model: Handle<mrv_model>, changes: Pointer<mrv_instance_change>, count: usize
) -> updated: Made<mrv_model> {
    // SAFETY: the caller gives `count` records.
    let changes = unsafe { changes_of(changes, count) }?;
    NamedModel::new(model.model.update(&changes)?)
});

/// The changes of a caller: records of the size that the first one states.
///
/// # Safety
/// `changes` is NULL or has `count` such records, with text as the header states.
unsafe fn changes_of(changes: *const mrv_instance_change, count: usize) -> Outcome<Vec<InstanceChange>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    check_pointer(changes, "changes")?;
    // SAFETY: there is a first record, which begins with its size.
    let stride = unsafe { changes.cast::<usize>().read() };
    if count.checked_mul(stride.max(1)).is_none_or(|bytes| isize::try_from(bytes).is_err()) {
        return wrong(format!("`changes` with {count} entries is larger than memory: give their number"));
    }
    let mut all = Vec::new();
    for i in 0..count {
        let name = format!("changes[{i}]");
        let entry = changes.cast::<u8>().wrapping_add(i.wrapping_mul(stride)).cast::<mrv_instance_change>();
        // SAFETY: as for this function; the address is that of a record, which `read_entry` checks.
        let given = unsafe { read_entry(entry, &name) }?;
        if given.struct_size != stride {
            return wrong(format!(
                "`{name}.struct_size` {}: must be {stride}, as the first",
                given.struct_size
            ));
        }
        // SAFETY: as for this function.
        all.push(unsafe { change(&given, &name) }?);
    }
    Ok(all)
}

/// # Safety
/// The record holds text as the header states.
unsafe fn change(given: &mrv_instance_change, name: &str) -> Outcome<InstanceChange> {
    no_reserved(given.reserved, &format!("{name}.reserved"))?;
    let (instance, transform) = (given.instance, rows_of(&given.transform));
    Ok(match given.kind {
        MRV_CHANGE_MOVE => InstanceChange::Move { instance, transform },
        MRV_CHANGE_ADD => InstanceChange::Add(Instance {
            mesh: given.mesh,
            transform,
            // The crate refuses numbers of no material by their value.
            material: (given.material != i64::from(MRV_MATERIAL_KEEP))
                .then(|| u32::try_from(given.material).unwrap_or(u32::MAX)),
            // SAFETY: as for this function.
            name: unsafe { optional_text(given.name, &format!("{name}.name")) }?.unwrap_or("instance").into(),
            visible: true,
            removed: false,
        }),
        MRV_CHANGE_REMOVE => InstanceChange::Remove { instance },
        MRV_CHANGE_SHOW => InstanceChange::Show { instance, visible: true },
        MRV_CHANGE_HIDE => InstanceChange::Show { instance, visible: false },
        kind => {
            return wrong(format!("`{name}.kind` {kind}: give one of MRV_CHANGE_MOVE to MRV_CHANGE_HIDE"));
        }
    })
}

/// The rows of a 3 by 4 matrix.
pub fn rows_of(numbers: &[f64; 12]) -> [[f64; 4]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| numbers[4 * row + column]))
}

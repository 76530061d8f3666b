//! One action for ever; doing nothing is the action zero.

use crate::batch::SliceMut;
use crate::error::PolicyError;
use crate::policy::{Policy, scripted, write_action};
use crate::space::Space;

/// Repeats one action: `constant:0.5,0`; doing nothing is `constant` without values (zeros).
pub fn constant(values: Vec<f32>) -> impl Policy {
    let description = match values.as_slice() {
        [] => "constant".to_owned(),
        values => format!("constant:{}", values.iter().map(f32::to_string).collect::<Vec<_>>().join(",")),
    };
    scripted(description, move |view, action| {
        let dim = view.spec.action.dim();
        let wrong = |reason: String| PolicyError::Argument { policy: "constant".to_owned(), reason };
        if values.is_empty() {
            do_nothing(&view.spec.action, action);
            return Ok(());
        }
        if values.len() != dim {
            let reason = format!("{} value(s) given, the action of {} has {dim}", values.len(), view.spec.id);
            return Err(wrong(reason));
        }
        if let (SliceMut::I64(_), Some(value)) = (&*action, values.iter().find(|value| value.fract() != 0.0))
        {
            return Err(wrong(format!("{value} is no integer, as the actions of {} are", view.spec.id)));
        }
        write_action(action, &values);
        Ok(())
    })
}

/// Zeros; for integers, the allowed values nearest to zero.
fn do_nothing(space: &Space, action: &mut SliceMut<'_>) {
    match (space, action) {
        (_, SliceMut::F32(out)) => out.fill(0.0),
        (_, SliceMut::F64(out)) => out.fill(0.0),
        (Space::Discrete { n, start }, SliceMut::I64(out)) => out.fill(0.clamp(*start, start + n - 1)),
        (Space::MultiDiscrete { n, start }, SliceMut::I64(out)) => {
            for (out, (n, start)) in out.iter_mut().zip(n.iter().zip(start)) {
                *out = 0.clamp(*start, start + n - 1);
            }
        }
        _ => unreachable!("action spaces are boxes or integers"),
    }
}

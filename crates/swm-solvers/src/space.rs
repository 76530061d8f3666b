//! How actions look inside a plan. What they are in the environment is [`swm_core::Space`]'s part.

use swm_core::Space;

use crate::error::PlanError;

/// A: numbers that stand for one action of `space` in a plan. Real numbers stand for themselves; an integer is
/// one-hot, a number per category.
pub fn plan_width(space: &Space) -> usize {
    match space {
        Space::Discrete { .. } | Space::MultiDiscrete { .. } => categories(space).sum(),
        space => space.width(),
    }
}

/// How many categories every integer of an action has; nothing for real numbers.
pub fn categories(space: &Space) -> impl Iterator<Item = usize> + Clone {
    let counts: &[i64] = match space {
        Space::Discrete { n, .. } => std::slice::from_ref(n),
        Space::MultiDiscrete { n, .. } => n,
        _ => &[],
    };
    counts.iter().map(|&n| usize::try_from(n).unwrap_or(0))
}

/// Refuses everything but integers, in the name of `solver`.
pub(crate) fn check_categories(solver: &'static str, space: &Space) -> Result<(), PlanError> {
    let refuse = |reason| Err(PlanError::Space { solver, reason });
    if !matches!(space, Space::Discrete { .. } | Space::MultiDiscrete { .. }) {
        return refuse(format!("it needs integers, and the action space is {}", space.kind()));
    }
    if let Some(index) = categories(space).position(|count| count == 0) {
        return refuse(format!("element {index} of the action has no categories"));
    }
    if plan_width(space) == 0 {
        return refuse("the action has no elements".to_owned());
    }
    Ok(())
}

/// The first of the largest numbers: the category that a group of a plan stands for.
pub fn largest(group: &[f32]) -> usize {
    let mut best = 0;
    for (index, &value) in group.iter().enumerate() {
        if value > group[best] {
            best = index;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use swm_core::Dtype;

    use super::*;

    #[test]
    fn integers_are_one_hot_and_reals_stand_for_themselves() {
        let two = Space::MultiDiscrete { n: vec![3, 5], start: vec![0, -1] };
        assert_eq!((plan_width(&two), categories(&two).collect()), (8, vec![3, 5]));
        let one = Space::Discrete { n: 4, start: 1 };
        assert_eq!((plan_width(&one), categories(&one).collect()), (4, vec![4]));
        let real = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
        assert_eq!((plan_width(&real), categories(&real).count()), (2, 0));
        assert_eq!(largest(&[0.0, 0.5, 0.5]), 1);
    }
}

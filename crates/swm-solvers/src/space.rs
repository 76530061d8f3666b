//! How actions are represented in a plan.

use swm_core::Space;

use crate::error::PlanError;

/// A: values of a plan per action of `space`. A real number is one value; an integer is one-hot, a value per category.
pub fn plan_dim(space: &Space) -> usize {
    match space {
        Space::Discrete { .. } | Space::MultiDiscrete { .. } => {
            categories(space).fold(0, usize::saturating_add)
        }
        space => space.dim(),
    }
}

/// The number of categories of every integer of an action; empty for real actions.
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
    if plan_dim(space) == 0 {
        return refuse("the action has no elements".to_owned());
    }
    Ok(())
}

/// The first of the largest values: the category that a group of a plan stands for.
pub fn largest(group: &[f32]) -> usize {
    let mut best = 0;
    for (index, &value) in group.iter().enumerate() {
        if value > group[best] {
            best = index;
        }
    }
    best
}

/// The values of plans, one group per integer.
pub(crate) fn groups<'a>(action: &Space, plan: &'a mut [f32]) -> impl Iterator<Item = &'a mut [f32]> {
    let mut rest = plan;
    categories(action).cycle().map_while(move |count| {
        let (group, tail) = std::mem::take(&mut rest).split_at_mut_checked(count)?;
        rest = tail;
        Some(group)
    })
}

/// Makes every group of categories one-hot.
pub(crate) fn round(space: &Space, plans: &mut [f32]) {
    for group in groups(space, plans) {
        let chosen = largest(group);
        group.fill(0.0);
        group[chosen] = 1.0;
    }
}

#[cfg(test)]
mod tests {
    use swm_core::Dtype;

    use super::*;

    #[test]
    fn integers_are_one_hot_and_reals_are_themselves() {
        let two = Space::MultiDiscrete { n: vec![3, 5], start: vec![0, -1] };
        assert_eq!((plan_dim(&two), categories(&two).collect()), (8, vec![3, 5]));
        let one = Space::Discrete { n: 4, start: 1 };
        assert_eq!((plan_dim(&one), categories(&one).collect()), (4, vec![4]));
        let real = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
        assert_eq!((plan_dim(&real), categories(&real).count()), (2, 0));
        assert_eq!(largest(&[0.0, 0.5, 0.5]), 1);
    }
}

//! What a policy lost against the oracle, for people.

use crate::evaluation::Regret;

/// What the policy lost against the oracle, in one line: after the first plan, and after the later ones where there are any.
pub(super) fn regret_line(regret: &Regret) -> String {
    let Regret { first_plan, first_plan_median, by_plan, at_end, .. } = regret;
    let later = match by_plan.get(1..) {
        Some(later) if !later.is_empty() => {
            let later: Vec<String> = later.iter().map(|lost| format!("{lost:.3}")).collect();
            format!("; mean after each later plan: {}", later.join(", "))
        }
        // Receipts of earlier programs have no later plans, but the end.
        _ if by_plan.is_empty() && at_end != first_plan => format!("; mean at the end: {at_end:.3}"),
        _ => String::new(),
    };
    format!(
        "regret against the oracle, in task cost: mean {first_plan:.3} (median {first_plan_median:.3}) after the first plan{later}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_regret_is_told_once() {
        let told = |by_plan: &[f64], at_end| {
            let by_plan = by_plan.to_vec();
            regret_line(&Regret { pairs: 2, first_plan: 1.5, first_plan_median: 1.25, by_plan, at_end })
        };
        let first = "regret against the oracle, in task cost: mean 1.500 (median 1.250) after the first plan";
        assert_eq!(told(&[1.5], 1.5), first);
        assert_eq!(told(&[1.5, 3.0, 2.5], 2.5), format!("{first}; mean after each later plan: 3.000, 2.500"));
        assert_eq!(told(&[], 2.5), format!("{first}; mean at the end: 2.500"));
    }
}

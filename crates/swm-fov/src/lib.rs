//! Factors of variation: declare, sample, constrain, fix, describe.

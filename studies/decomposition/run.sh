#!/bin/bash
# Run every suite of this study in the tiers named, by default both, with the causalbench on the path; again continues.
set -e
cd "$(dirname "$0")/../.."
[ $# -gt 0 ] || set -- kinematic gymrob
for tier; do
  for suite in studies/decomposition/suite*.yaml; do
    causalbench run "$suite" --tier "$tier"
  done
done

#!/usr/bin/env bash
# bags/make.sh NAME: record a bag of this folder anew; twice, because the first run may compile the kernels.
set -eu
name=${1-}
small='recorder.exclude=["/diagnostics","*/truth/*","*/arm/backbone","*/transition_event"]'
case $name in
  track_circle_lockstep_2s) keys=(duration_s=2) ;;
  imu_and_outliers) keys=(duration_s=1 "name=$name" controller.law=adaptive twin.imu.enabled=true
    twin.pose.drop=0.1 twin.pose.outlier=0.02 "$small") ;;
  two_links) keys=(duration_s=1 "name=$name" robot=asu_two_segment platform=
    controller.reference.curvature_per_m=0.4 controller.reference.choose_elongation=false "$small") ;;
  *) echo "bags/make.sh: got '$name'; allowed: track_circle_lockstep_2s, imu_and_outliers, two_links" >&2; exit 2 ;;
esac
cd "$(dirname "$0")/.."
soro=$(command -v .venv/bin/soro || command -v soro)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
sets=()
for key in mode=lockstep "${keys[@]}"; do sets+=(--set "$key"); done
for run in first second; do
  "$soro" run track_circle "${sets[@]}" --folder "$folder/$run"
done
rm -rf "bags/$name"
cp -r "$folder"/second/*/bag "bags/$name"
cp "$folder"/second/*/scene_used.yaml "bags/$name/scene.yaml"
"$soro" replay "bags/$name" --tolerance 0

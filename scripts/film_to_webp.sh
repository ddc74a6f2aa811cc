#!/usr/bin/env bash
# Converts a film to an animated picture for a web page: every second frame, 960 pixels wide, the last one shown longer.
#   scripts/film_to_webp.sh outputs/fig7/execution.mp4 docs/images/arm.webp       BIN: where the simulator's Python is
set -euo pipefail
[ $# -eq 2 ] && [ -f "$1" ] || { echo "film_to_webp: got '$*', want FILM.mp4 PICTURE.webp" >&2; exit 2; }
ffmpeg=$("${BIN:-.venv/bin}/python" -c "import imageio_ffmpeg; print(imageio_ffmpeg.get_ffmpeg_exe())")
look="select='not(mod(n,2))',scale=960:-2:flags=lanczos,tpad=stop_mode=clone:stop_duration=2.5"
"$ffmpeg" -loglevel error -y -i "$1" -vf "$look" -fps_mode vfr -c:v libwebp_anim -quality 60 -loop 0 "$2"

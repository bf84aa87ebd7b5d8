#!/bin/sh
# Certificates, passwords and the list of users of a fleet that is tried out: `configs/make-test-certificates.sh FOLDER NAME...`
# with the names of the vehicles and watchers, as uav-1 uav-2 ground. The authority's key stays in the folder, so keep
# none of this for a fleet that flies: let your own authority sign, and give each computer its own files only.
set -eu
if [ $# -lt 2 ]; then
    echo "usage: $0 FOLDER NAME..." >&2
    exit 2
fi
folder=$1
shift
umask 077
mkdir -p "$folder"
cd "$folder"

key() {
    openssl ecparam -name prime256v1 -genkey -noout -out "$1.key"
}

key ca
openssl req -x509 -new -key ca.key -out ca.pem -days 365 -subj "/CN=test fleet" \
    -addext basicConstraints=critical,CA:TRUE
: >users.txt
for name in router "$@"; do
    key "$name"
    printf 'subjectAltName=DNS:localhost,IP:127.0.0.1\nextendedKeyUsage=serverAuth,clientAuth\n' >extensions
    openssl req -new -key "$name.key" -out request -subj "/CN=$name"
    openssl x509 -req -in request -CA ca.pem -CAkey ca.key -CAcreateserial -out "$name.pem" -days 365 \
        -extfile extensions 2>/dev/null
    if [ "$name" != router ]; then
        openssl rand -hex 16 >"$name.password"
        printf '%s:%s\n' "$name" "$(cat "$name.password")" >>users.txt
    fi
done
rm -f request extensions ca.srl
echo "written to $folder: the router's files, and those of $*"

#!/bin/sh
# Makes a certificate authority and certificates for trying out config/zenoh-fleet.json5. Not for a real fleet:
# the authority's key stays beside the certificates, unprotected.
#
#   config/make-test-ca.sh FOLDER [NAME...]     NAMEs default to: router rover1 rover2 viewer operator
#
# NAME becomes the common name, by which the access rules tell who is who. Valid 30 days, for localhost.
set -eu
folder=${1:?"usage: make-test-ca.sh FOLDER [NAME...]"}
shift
[ $# -gt 0 ] || set -- router rover1 rover2 viewer operator
mkdir -p "$folder"
cd "$folder"
umask 077

quietly() { openssl "$@" 2>openssl.log || { cat openssl.log >&2; exit 1; }; }

if [ ! -e ca.pem ]; then
    quietly req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 30 -subj "/CN=infant test CA" \
        -addext "basicConstraints=critical,CA:TRUE" -addext "keyUsage=critical,keyCertSign,cRLSign" \
        -keyout ca.key -out ca.pem
fi
for name in "$@"; do
    quietly req -new -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj "/CN=$name" \
        -keyout "$name.key" -out "$name.csr"
    # zenoh wants a subject alternative name and, on either side of mutual TLS, the use that fits the side
    printf '%s\n' "subjectAltName=DNS:localhost,DNS:$name,IP:127.0.0.1" "basicConstraints=critical,CA:FALSE" \
        "keyUsage=critical,digitalSignature" "extendedKeyUsage=serverAuth,clientAuth" >"$name.ext"
    quietly x509 -req -in "$name.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days 30 -extfile "$name.ext" -out "$name.pem"
    rm "$name.csr" "$name.ext"
done
rm -f openssl.log

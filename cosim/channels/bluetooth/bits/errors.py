"""Bit errors of Basic Rate, and how often they break which part of a packet.

GFSK with modulation index h, detected without carrier phase, makes an error with probability (Robert, Valenti; Proakis
for two correlated signals), with g = Es/N0 and rho = abs(sin(2 pi h) / (2 pi h)),

    Pb = Q1(a, b) - exp(-(a^2 + b^2) / 2) I0(a b) / 2,    a, b = sqrt(g / 2 (1 -+ sqrt(1 - rho^2)))

Q1(a, b) is the sum of exp(-(a^2 + b^2) / 2) (a / b)^k I_k(a b) over k >= 0, a^2 + b^2 = g and a b = g rho / 2. So

    Pb = exp(-g / 2) [I0(z) / 2 + sum over k >= 1 of r^k I_k(z)],    z = g rho / 2,    r = rho / (1 + sqrt(1 - rho^2))

in which nothing cancels and, as r = 0.24 for h = 0.32, every term is less than a quarter of the one before. Bit errors
are independent. A packet is made of sections (Core v1.2, Vol 2 Part B, sections 6 and 7):

    access code  72 bits (68 in an ID packet, which has no trailer); lost if more than 7 are wrong
    header       18 bits, each sent three times; lost if two or three copies of any bit are wrong
    payload      DM, FHS: every 10 bits as 15, a block is lost with more than one wrong bit; DH: lost with any wrong bit

The exact probabilities come from scipy; a run takes them from kernels that interpolate the logarithm of the bit error
rate in a table.
"""

import math
from collections.abc import Iterable
from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

import cosim.elementary as elementary
from cosim.arrays import Floats
from cosim.channels.bluetooth.packets import ACCESS_CODE_BITS, HEADER_BITS, ID_BITS, TOLERATED_BITS, PacketType
from cosim.jit import njit
from cosim.units import MS, SLOT

MODULATION_INDEX: Final = 0.32
"""Nominal modulation index; the specification allows 0.28 to 0.35."""
NEGLIGIBLE: Final = 2.0**-40
"""Probability below which a kernel returns 0."""
SENSITIVITY_BER: Final = 1e-3
"""The bit error rate at which the specification measures sensitivity."""

# the sections of a packet
NONE: Final = 0
ACCESS_CODE: Final = 1
HEADER: Final = 2
PAYLOAD: Final = 3


# ---------------------------------------------------------------- exact


def bit_error_rate(es_n0_db: npt.ArrayLike, modulation_index: float = MODULATION_INDEX) -> Floats:
    """Return the probability that a bit is wrong at *es_n0_db*, of any shape, dB; the formula of this module."""
    from scipy import special  # loading it takes a quarter of a second; runs use the table instead

    g = 10.0 ** (np.asarray(es_n0_db, dtype=np.float64) / 10.0)
    rho = abs(elementary.sin(2 * math.pi * modulation_index) / (2 * math.pi * modulation_index))
    ratio = rho / (1.0 + math.sqrt(1.0 - rho * rho))
    z = 0.5 * rho * g
    # ive(k, z) is exp(-z) I_k(z)
    total = 0.5 * special.ive(0, z)
    for k in range(1, 1 + math.ceil(-40.0 / elementary.log(ratio))):
        total = total + ratio**k * special.ive(k, z)
    return np.asarray(np.exp(z - 0.5 * g) * total)


@cache
def es_n0_db_at(bit_errors: float) -> float:
    """Return the Es/N0 in dB, to 1e-9, at which the bit error rate is *bit_errors*.

    Raise ValueError if it is not between the rates at -20 and 20 dB.
    """
    low, high = -20.0, 20.0
    if not bit_error_rate(high) < bit_errors < bit_error_rate(low):
        raise ValueError(f"a bit error rate of {bit_errors} is not met between {low:g} and {high:g} dB")
    while high - low > 1e-9:  # the rate falls all the way
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bit_error_rate(middle) > bit_errors else (low, middle)
    return 0.5 * (low + high)


def section_errors(kind: PacketType, length: int, es_n0_db: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return the exact probabilities, each of the shape of *es_n0_db* (dB), that a section is broken by itself.

    The sections are access code, header and payload of a packet of type *kind* with *length* bytes of user data; what
    a type does not have is never broken. Raise ValueError if the bytes do not fit.
    """
    wrong = bit_error_rate(es_n0_db)
    never = np.zeros_like(wrong)
    bits = kind.payload_bits(length)
    access = _more_than(TOLERATED_BITS, ID_BITS if kind.name == "ID" else ACCESS_CODE_BITS, wrong)
    if kind.name == "ID":
        return access, never, never
    header = _any_of(HEADER_BITS, _more_than(1, 3, wrong))
    payload = _any_of(-(-bits // 10), _more_than(1, 15, wrong)) if kind.coded else _any_of(bits, wrong)
    return access, header, payload


def throughput_kbps(kind: PacketType, es_n0_db: npt.ArrayLike) -> Floats:
    """Return the rate in kb/s, of the shape of *es_n0_db* (dB), of full packets sent one way and repeated until heard.

    A packet counts if all of it arrives, and the access code and header of the NULL that acknowledges it (Valenti,
    Robert, Reed, WCNC 2002).
    """
    access, header, payload = section_errors(kind, kind.capacity, es_n0_db)
    heard = ((1 - access) * (1 - header)) ** 2 * (1 - payload)
    return np.asarray(8 * kind.capacity * heard * MS / ((kind.slots + 1) * SLOT))


def _more_than(limit: int, bits: int, wrong: Floats) -> Floats:
    from scipy import special

    return np.asarray(special.bdtrc(limit, bits, wrong), dtype=np.float64)


def _any_of(count: int, each: Floats) -> Floats:
    """Return the probability that at least one of *count* independent things happens."""
    return np.asarray(-np.expm1(count * np.log1p(-each)))


# ---------------------------------------------------------------- for the run

_STEPS_PER_DB: Final = 8
_LOWEST_DB: Final = -40.0
CLEAR_DB: Final = 22.0
"""Es/N0 in dB above which even the longest payload is broken with negligible probability only."""
_LOG_BER: Final[Floats] = np.fromstring(
    """
-0.6931905644335539 -0.6931918312621469 -0.6931931350826017 -0.6931944769750886 -0.6931958580513182 -0.6931972794554633
-0.693198742365106 -0.6932002479922138 -0.6932017975841432 -0.6932033924246737 -0.6932050338350703 -0.6932067231751786
-0.6932084618445515 -0.6932102512836087 -0.6932120929748292 -0.6932139884439801 -0.6932159392613799 -0.6932179470432001
-0.6932200134528037 -0.6932221402021229 -0.6932243290530773 -0.693226581819035 -0.6932289003663107 -0.6932312866157168
-0.6932337425441514 -0.6932362701862366 -0.6932388716360035 -0.6932415490486288 -0.6932443046422175 -0.6932471406996417
-0.6932500595704317 -0.693253063672722 -0.6932561554952535 -0.6932593375994376 -0.693262612621474 -0.6932659832745394
-0.6932694523510297 -0.6932730227248766 -0.6932766973539277 -0.693280479282395 -0.693284371643378 -0.6932883776614587
-0.6932925006553715 -0.6932967440407536 -0.6933011113329736 -0.6933056061500423 -0.6933102322156119 -0.6933149933620577
-0.6933198935336541 -0.6933249367898406 -0.6933301273085845 -0.6933354693898418 -0.6933409674591177 -0.6933466260711341
-0.6933524499135983 -0.69335844381109 -0.6933646127290539 -0.6933709617779137 -0.6933774962173047 -0.6933842214604293
-0.6933911430785402 -0.693398266805556 -0.6934055985428073 -0.693413144363927 -0.6934209105198784 -0.6934289034441324
-0.6934371297579964 -0.6934455962760965 -0.6934543100120207 -0.693463278184129 -0.6934725082215297 -0.6934820077702303
-0.6934917846994717 -0.6935018471082431 -0.693512203331989 -0.6935228619495104 -0.6935338317900707 -0.693545121940704
-0.6935567417537417 -0.6935687008545545 -0.6935810091495237 -0.6935936768342432 -0.6936067144019593 -0.6936201326522616
-0.6936339427000221 -0.6936481559845987 -0.6936627842793053 -0.693677839701159 -0.6936933347209117 -0.6937092821733734
-0.6937256952680378 -0.6937425876000182 -0.6937599731612998 -0.6937778663523229 -0.6937962819939034 -0.6938152353395001
-0.6938347420878389 -0.6938548183959096 -0.6938754808923362 -0.6938967466911401 -0.6939186334059035 -0.6939411591643487
-0.6939643426233366 -0.6939882029843089 -0.6940127600091763 -0.6940380340366727 -0.6940640459991818 -0.6940908174400606
-0.6941183705314631 -0.6941467280926831 -0.6941759136090369 -0.69420595125129 -0.6942368658956547 -0.6942686831443666
-0.6943014293468651 -0.6943351316215861 -0.6943698178783949 -0.6944055168416676 -0.6944422580740489 -0.6944800720009007
-0.6945189899354607 -0.6945590441047373 -0.6946002676761568 -0.6946426947849867 -0.6946863605625583 -0.694731301165308
-0.6947775538046724 -0.6948251567778411 -0.6948741494994165 -0.6949245725339892 -0.694976467629661 -0.6950298777525471
-0.6950848471222799 -0.6951414212485452 -0.6951996469686831 -0.6952595724863831 -0.695321247411501 -0.695384722801039
-0.6954500512013139 -0.6955172866913524 -0.6955864849275486 -0.6956577031896187 -0.695731000427892 -0.6958064373119768
-0.6958840762808383 -0.6959639815943345 -0.696046219386247 -0.696130857718852 -0.696217966639077 -0.6963076182362883
-0.6963998867017547 -0.6964948483898377 -0.6965925818809595 -0.6966931680463934 -0.6967966901149396 -0.6969032337415298
-0.6970128870778235 -0.6971257408448511 -0.6972418884077639 -0.6973614258527454 -0.6974844520661581 -0.6976110688159765
-0.6977413808355828 -0.6978754959099867 -0.6980135249645408 -0.698155582156225 -0.6983017849675681 -0.6984522543032923
-0.698607114589744 -0.6987664938772058 -0.6989305239451612 -0.699099340410601 -0.6992730828394577 -0.6994518948612584
-0.6996359242870838 -0.6998253232309326 -0.7000202482345844 -0.7002208603960651 -0.70042732550181 -0.7006398141626385
-0.7008585019536431 -0.7010835695581024 -0.7013152029155383 -0.7015535933740286 -0.7017989378468991 -0.7020514389739184
-0.7023113052871199 -0.7025787513813875 -0.7028539980899284 -0.703137272664788 -0.7034288089625268 -0.7037288476352259
-0.7040376363269523 -0.7043554298758508 -0.7046824905220107 -0.7050190881212749 -0.7053655003651531 -0.705722013007009
-0.7060889200947034 -0.7064665242098598 -0.7068551367139507 -0.7072550780013797 -0.7076666777597646 -0.7080902752376134
-0.7085262195195984 -0.7089748698096379 -0.7094365957220033 -0.709911777580662 -0.7104008067270935 -0.7109040858368019
-0.7114220292447617 -0.7119550632800492 -0.7125036266098902 -0.7130681705934041 -0.7136491596452781 -0.714247071609662
-0.7148623981445482 -0.7154956451169155 -0.7161473330089262 -0.7168179973354784 -0.7175081890734024 -0.7182184751026174
-0.7189494386595636 -0.7197016798032306 -0.7204758158941119 -0.7212724820864255 -0.7220923318339458 -0.7229360374097941
-0.7238042904405567 -0.7246978024550944 -0.7256173054484172 -0.7265635524610118 -0.7275373181740185 -0.7285393995206441
-0.7295706163142343 -0.7306318118934121 -0.7317238537847107 -0.7328476343831313 -0.7340040716510697 -0.7351941098360594
-0.736418720207783 -0.7376789018148288 -0.7389756822616517 -0.7403101185062311 -0.7416832976789053 -0.7430963379228871
-0.7445503892569587 -0.7460466344608603 -0.747586289983887 -0.749170606877228 -0.7508008717505695 -0.7524784077535099
-0.7542045755823262 -0.7559807745126439 -0.7578084434585668 -0.7596890620588311 -0.7616241517905419 -0.7636152771110701
-0.765664046628679 -0.7677721143024576 -0.7699411806721373 -0.772172994118378 -0.7744693521540973 -0.7768321027474295
-0.7792631456768916 -0.7817644339193339 -0.7843379750712567 -0.7869858328040542 -0.7897101283537642 -0.7925130420458733
-0.7953968148557381 -0.7983637500051618 -0.8014162145956587 -0.8045566412789333 -0.8077875299650725 -0.8111114495689524
-0.814531039795324 -0.8180490129630433 -0.8216681558688694 -0.8253913316912469 -0.8292214819344573 -0.8331616284134871
-0.8372148752799484 -0.8413844110893343 -0.8456735109098723 -0.8500855384731818 -0.8546239483669236 -0.8592922882695591
-0.8640942012273074 -0.8690334279733292 -0.8741138092891098 -0.8793392884079678 -0.8847139134605354 -0.890241839962013
-0.8959273333409089 -0.901774771508933 -0.9077886474716058 -0.9139735719790901 -0.920334276216658 -0.9268756145341281
-0.9336025672135128 -0.9405202432740289 -0.9476338833135323 -0.9549488623853304 -0.9624706929092525 -0.9702050276157254
-0.9781576625215305 -0.9863345399357994 -0.9947417514947186 -1.0033855412232908 -1.0122723086224406 -1.0214086117796162
-1.0308011705009836 -1.0404568694632035 -1.0503827613827112 -1.0605860702003662 -1.0710741942792477 -1.0818547096133713
-1.092935373045041 -1.1043241254885574 -1.1160290951580116 -1.1280586007969335 -1.1404211549076249 -1.1531254669781001
-1.1661804467047103 -1.1795952072086768 -1.19337906824499 -1.2075415594024195 -1.2220924232936754 -1.2370416187351922
-1.2523993239164384 -1.2681759395592243 -1.28438209206808 -1.301028636673523 -1.3181266605708255 -1.3356874860578494
-1.3537226736765469 -1.3722440253639085 -1.3912635876194475 -1.410793654697779 -1.430846771836454 -1.451435738530982
-1.4725736118709423 -1.4942737099531822 -1.516549615390441 -1.5394151789362136 -1.5628845232493767 -1.5869720468250017
-1.611692428120837 -1.6370606299122497 -1.663091903911875 -1.6898017956938345 -1.7172061499662374 -1.7453211162395659
-1.774163154942648 -1.8037490440420398 -1.8340958862248535 -1.8652211167092527 -1.897142511751001 -1.929878197918498
-1.9634466622126028 -1.997866763111186 -2.03315774262162 -2.0693392394273165 -2.106431303216722 -2.1444544102849186
-2.183429480498929 -2.2233778957179346 -2.264321519758732 -2.306282719994794 -2.3492843906741263 -2.3933499780366128
-2.4385035073056356 -2.484769611621381 -2.5321735629742568 -2.5807413051863515 -2.6304994889766817 -2.681475509132298
-2.733697543792085 -2.78719459583351 -2.8419965363347153 -2.8981341500654967 -2.9556391829411193 -3.014544391352816
-3.074883593268735 -3.1366917209792664 -3.2000048753417127 -3.2648603813615544 -3.3312968449316696 -3.399354210537288
-3.4690738197237883 -3.5404984701170368 -3.613672474782485 -3.6886417217098995 -3.7654537332158444 -3.844157725066095
-3.924804665135031 -4.007447331438988 -4.092140369405062 -4.178940348266005 -4.2679058165049515 -4.359097356310295
-4.452577637040468 -4.5484114677395935 -4.6466658487873715 -4.747410022808892 -4.850715525011367 -4.956656233154075
-5.0653084173939815 -5.176750790281647 -5.291064557209303 -5.408333467634604 -5.528643867419058 -5.65208475262902
-5.778747825149368 -5.9087275504555 -6.042121217878398 -6.179029003680638 -6.3195540372391426 -6.463802470603835
-6.611883551671241 -6.763909701179626 -6.919996593698275 -7.080263242749576 -7.244832090169438 -7.413829099780342
-7.587383855423145 -7.76562966336896 -7.948703659112132 -8.1367469185295 -8.329904573380217 -8.528325931114411
-8.732164598957523 -8.941578612240262 -9.156730566951 -9.37778775649759 -9.604922312678598 -9.83831135087863
-10.078137119518795 -10.324587153810006 -10.577854433873915 -10.838137547312686 -11.10564085632454 -11.3805746694767
-11.663155418260647 -11.953605838566535 -12.252155157224303 -12.559039283768172 -12.874501007589378 -13.198790200649007
-13.532164025928981 -13.874887151804899 -14.227231972529276 -14.58947883501873 -14.96191627214309 -15.344841242719038
-15.738559378415564 -16.14338523778319 -16.559642567624003 -16.987664571924817 -17.42779418858099 -17.88038437414473
-18.34579839683716 -18.824410138070224 -19.316604402730956 -19.822777238487507 -20.343336264383623 -20.878701008995584
-21.429303258433396 -21.99558741447597 -22.578010863138353 -23.177044353977504 -23.793172390451886 -24.426893631659297
-25.078721305786637 -25.749183635614948 -26.438824276433124 -27.148202766723593 -27.87789499199418 -28.628493662140976
-29.400608802738223 -30.19486826066295 -31.011918224473547 -31.852423759973938 -32.717069361407795 -33.60655951873922
-34.52161930149119 -35.46299495962492 -36.431454541958985 -37.42778853264079 -38.452810506197515 -39.5073578017105
-40.592292216670806 -41.70850072109203 -42.85689619247194 -44.03841817221161 -45.254033644119986 -46.504737835648164
-47.79155504251793
""",
    sep=" ",
)
"""Logarithm of :func:`bit_error_rate`, in steps of 1/8 dB, from a step below the lowest to one above the highest place.

Written out, so that a run does not depend on the last bits of a library, nor waits for it to load.
"""


@njit(cache=True)
def fast_bit_error_rate(es_n0_db: float) -> float:
    """Return the bit error rate at *es_n0_db*, 1e-5 of it wrong at most; 0 above 22 dB; a kernel for kernels.

    A cubic through the four nearest entries of a table of the logarithm, in steps of 1/8 dB. Below -40 dB the value
    there, which is a half but for 1e-4 of it.
    """
    if es_n0_db >= CLEAR_DB:
        return 0.0
    x = (max(es_n0_db, _LOWEST_DB) - _LOWEST_DB) * _STEPS_PER_DB
    at = int(x)
    t = x - at
    before, low, high, after = _LOG_BER[at], _LOG_BER[at + 1], _LOG_BER[at + 2], _LOG_BER[at + 3]
    outer = t * (t - 1.0) * ((t + 1.0) * after - (t - 2.0) * before) / 6.0
    inner = (t + 1.0) * (t - 2.0) * ((t - 1.0) * low - t * high) / 2.0
    return elementary.exp(outer + inner)


@njit(cache=True)
def _tail(limit: int, bits: int, wrong: float) -> float:
    """Return the probability that more than *limit* of *bits* are wrong, each with probability *wrong* <= 1/2."""
    if wrong == 0.0:
        return 0.0
    odds = wrong / (1.0 - wrong)
    term = (1.0 - wrong) ** bits
    for k in range(limit + 1):
        term *= odds * (bits - k) / (k + 1)
    total = term
    for k in range(limit + 1, bits):
        factor = odds * (bits - k) / (k + 1)
        term *= factor
        total += term
        if factor < 0.5 and term < 1e-12 * total:
            break
    return total


@njit(cache=True)
def _at_least_one(count: int, each: float) -> float:
    if each >= 1.0:
        return 1.0 if count else 0.0
    probability = -elementary.expm1(count * elementary.log1p(-each))
    return probability if probability >= NEGLIGIBLE else 0.0


@njit(cache=True)
def section_probabilities(es_n0_db: float, payload_bits: int, coded: bool) -> tuple[float, float, float]:
    """Return the probabilities that access code, header and payload of a packet at *es_n0_db* are broken, for kernels.

    *payload_bits* are those of payload header, user data and CRC (FHS: 160; POLL and NULL: 0) before they are *coded*
    by the (15, 10) code, or not. 1e-4 of a probability is wrong at most, and 0 stands for less than 2**-40.
    """
    wrong = fast_bit_error_rate(es_n0_db)
    access = _at_least_one(1, _tail(TOLERATED_BITS, ACCESS_CODE_BITS, wrong))
    header = _at_least_one(HEADER_BITS, wrong * wrong * (3.0 - 2.0 * wrong))
    if coded:
        return access, header, _at_least_one((payload_bits + 9) // 10, _tail(1, 15, wrong))
    return access, header, _at_least_one(payload_bits, wrong)


@njit(cache=True)
def failed_section(w0: int, w1: int, w2: int, w3: int, p_access: float, p_header: float, p_payload: float) -> int:
    """Return which section of a packet is the first that breaks, or NONE, given four random words of 32 bits.

    The access code and the header take a word each, the payload 53 bits of two: it alone may matter when it breaks
    less often than once in 2**32. A kernel for kernels.
    """
    if w0 < p_access * 4294967296.0:
        return ACCESS_CODE
    if w1 < p_header * 4294967296.0:
        return HEADER
    if (w2 << 21 | w3 >> 11) * 2.0**-53 < p_payload:
        return PAYLOAD
    return NONE


# ---------------------------------------------------------------- the choice of a type


def best_type(types: Iterable[PacketType], length: int, es_n0_db: float) -> PacketType:
    """Return the one of *types* that carries *length* bytes at *es_n0_db* at the highest expected rate.

    The rate is that of :func:`throughput_kbps`, with this payload; of equal ones the type with the least capacity wins.
    Raise ValueError if none holds so many bytes.
    """
    fitting = sorted(
        (kind for kind in types if kind.header and kind.capacity >= length), key=lambda kind: kind.capacity
    )
    if not fitting:
        raise ValueError(f"no packet type that may be chosen holds {length} bytes")
    return max(fitting, key=lambda kind: _payload_success(kind, length, es_n0_db) / (kind.slots + 1))


def _payload_success(kind: PacketType, length: int, es_n0_db: float) -> float:
    # access codes and headers, those of the answer too, break alike whatever the type
    return 1.0 - section_probabilities(es_n0_db, kind.payload_bits(length), kind.coded)[2]

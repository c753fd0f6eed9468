/* Numbers of eight arms side by side, with the bits that each would have alone: what `double`, `bool` and `uint64_t` are in the
 * sources of plant and controllers where lanes.cpp includes them. GCC's vectors are the registers of whatever processor there
 * is: one of AVX-512, two of AVX. */
#ifndef NUMBER_H
#define NUMBER_H

#include <cmath>
#include <cstdint>
#include <cstring>

#define LANES 8

typedef double Numbers __attribute__((vector_size(8 * LANES)));
typedef int64_t Wholes __attribute__((vector_size(8 * LANES)));
typedef uint64_t Words __attribute__((vector_size(8 * LANES)));

/* Of each arm whether; all bits are set where it is so. */
struct Mask {
    Wholes of;
    friend Mask operator&&(Mask a, Mask b) { return {a.of & b.of}; }
    friend Mask operator||(Mask a, Mask b) { return {a.of | b.of}; }
    Mask operator!() const { return {~of}; }
};

struct Bits {
    Words of;
    Bits() = default;
    Bits(Words words) : of(words) {}
    Bits(int64_t same) : of(Words{} + (uint64_t)same) {}
    Bits(int same) : Bits((int64_t)same) {}
    friend Bits operator&(Bits a, Bits b) { return a.of & b.of; }
    friend Bits operator|(Bits a, Bits b) { return a.of | b.of; }
    friend Bits operator^(Bits a, Bits b) { return a.of ^ b.of; }
    friend Bits operator+(Bits a, Bits b) { return a.of + b.of; }
    friend Bits operator-(Bits a, Bits b) { return a.of - b.of; }
    friend Bits operator<<(Bits a, int n) { return a.of << n; }
    friend Bits operator>>(Bits a, int n) { return a.of >> n; }
};

struct Lane {
    Numbers of;
    Lane() = default;
    constexpr Lane(double same) : of{same, same, same, same, same, same, same, same} {}
    constexpr Lane(Numbers numbers) : of(numbers) {}
    explicit operator int() const { return (int)of[0]; } /* of what is the same for all arms */
    Lane operator-() const { return -of; }
    friend Lane operator+(Lane a, Lane b) { return a.of + b.of; }
    friend Lane operator-(Lane a, Lane b) { return a.of - b.of; }
    friend Lane operator*(Lane a, Lane b) { return a.of * b.of; }
    friend Lane operator/(Lane a, Lane b) { return a.of / b.of; }
    friend Mask operator<(Lane a, Lane b) { return {a.of < b.of}; }
    friend Mask operator<=(Lane a, Lane b) { return {a.of <= b.of}; }
    friend Mask operator>(Lane a, Lane b) { return {a.of > b.of}; }
    friend Mask operator>=(Lane a, Lane b) { return {a.of >= b.of}; }
    friend Mask operator==(Lane a, Lane b) { return {a.of == b.of}; }
    Lane &operator+=(Lane b) { return *this = *this + b; }
    Lane &operator-=(Lane b) { return *this = *this - b; }
    Lane &operator/=(Lane b) { return *this = *this / b; }
};

static inline Lane choose(Mask condition, Lane then, Lane otherwise) { return condition.of ? then.of : otherwise.of; }

static inline bool any(Mask condition)
{
    int64_t found = 0;
    for (int lane = 0; lane < LANES; lane++)
        found |= condition.of[lane];
    return found != 0;
}

typedef double Constant;

/* Entries of a table of 64. */
static inline Lane entry(const Constant table[64], Bits at)
{
#ifdef __AVX512F__
    /* Of registers: with eight loads in their place, a sample of eight arms took 2.07 us, not 1.99. */
    Numbers of[8], two[4];
    memcpy(of, table, sizeof of);
    const Wholes place = (Wholes)at.of;
    for (int i = 0; i < 4; i++)
        two[i] = __builtin_shuffle(of[2 * i], of[2 * i + 1], place & 15);
    const Wholes second = (place & 16) != 0, upper = (place & 32) != 0;
    const Numbers low = second ? two[1] : two[0], high = second ? two[3] : two[2];
    return upper ? high : low;
#else
    Lane found;
    for (int lane = 0; lane < LANES; lane++)
        found.of[lane] = table[at.of[lane]];
    return found;
#endif
}

/* Each arm's own. */
template <typename Function> static inline Lane each(Function function, Lane x)
{
    Lane made;
    for (int lane = 0; lane < LANES; lane++)
        made.of[lane] = function(x.of[lane]);
    return made;
}

static inline Lane fabs(Lane x) { return (Numbers)((Words)x.of & ~(Words{} + (1ull << 63))); }
static inline Lane copysign(Lane x, Lane sign)
{
    const Words place = Words{} + (1ull << 63);
    return (Numbers)(((Words)x.of & ~place) | ((Words)sign.of & place));
}
static inline Lane fmax(Lane a, Lane b) { return choose(a > b, a, b); }
static inline Lane fmin(Lane a, Lane b) { return choose(a < b, a, b); }
static inline Lane sqrt(Lane x) { return each([](double y) { return __builtin_sqrt(y); }, x); }
static inline Lane floor(Lane x) { return each([](double y) { return __builtin_floor(y); }, x); }
static inline Lane ceil(Lane x) { return each([](double y) { return __builtin_ceil(y); }, x); }
static inline Lane rint(Lane x) { return each([](double y) { return __builtin_rint(y); }, x); }
static inline Lane fmod(Lane x, Lane y)
{
    /* The library's takes longer than all else of a sample: of the number of the sample, which all arms share, one will do. */
    const Lane first = x.of[0], by = y.of[0];
    if (!any(!(x == first && y == by))) return std::fmod(x.of[0], y.of[0]);
    Lane made;
    for (int lane = 0; lane < LANES; lane++)
        made.of[lane] = std::fmod(x.of[lane], y.of[lane]);
    return made;
}

#endif

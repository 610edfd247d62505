// As much of Unreal as StepBlocksComponent names, so that a compiler can read it without Unreal.
#pragma once
#include <cstdint>
#include <mutex>
#include <string>

typedef uint32_t uint32;
#define UCLASS(...)
#define UPROPERTY(...)
#define UFUNCTION(...)
#define GENERATED_BODY()
#define TEXT(text) text
#define TCHAR_TO_UTF8(text) (text)
#define UTF8_TO_TCHAR(text) (text)
#define UE_LOG(category, level, ...) stub_log(__VA_ARGS__)

inline void stub_log(const char*, ...) {}

struct FString
{
    std::string text;
    const char* operator*() const { return text.c_str(); }
};

struct FVector
{
    double X, Y, Z;
    FVector(double x, double y, double z) : X(x), Y(y), Z(z) {}
};

typedef std::mutex FCriticalSection;

struct FScopeLock
{
    explicit FScopeLock(FCriticalSection* gate) : lock(*gate) {}
    std::lock_guard<std::mutex> lock;
};

namespace EEndPlayReason
{
enum Type { Quit };
}

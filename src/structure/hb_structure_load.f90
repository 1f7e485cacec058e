!> A load on a structure, such as `load_t`: it declares its numbers (hb_numbers), and adds its spectrum to that of all loads as
!> often as it changes. Each kind is a group of an input, a row of src/structure_loads.txt. Readers, sweeps, curves, ties,
!> derivatives and time integration know no kind.
module hb_structure_load
   use hb_kinds, only: wp
   use hb_load_course, only: load_course_t, timed_load_t
   use hb_numbers, only: number_t, numbered_t
   use hb_problems, only: problems_t
   use hb_spectrum, only: spectrum_t
   use hb_structure, only: structure_t
   use hb_text, only: max_name
   implicit none
   private
   public :: find_random_forces, find_timed_loads, is_only_in_time, is_random, load_box_t, random_structure_load_t, &
      structure_load_t, time_key_of, timed_structure_load_t

   type, extends(numbered_t), abstract :: structure_load_t
      integer, allocatable :: tuple(:)                                !! j, (n_tones); zeros if it has no key for it
      integer, allocatable :: dofs(:)                                 !! at which it acts; none if it has no key for them
      real(wp), allocatable :: weights(:)                             !! (size(dofs)); not allocated after a problem of the input
   contains
      procedure(add_load), deferred :: add_to
      procedure :: add_slope_to => structure_load_add_slope_to
      procedure :: check => structure_load_check
      procedure :: depends_on_frequency => structure_load_depends_on_frequency
      procedure :: depends_on_structure => structure_load_depends_on_structure
      procedure :: has_tuple => structure_load_has_tuple
      procedure :: is_zero => structure_load_is_zero
      procedure :: n_dofs => structure_load_n_dofs
      procedure :: repeats => structure_load_repeats
   end type structure_load_t

   !> A load that may have a course over time: it is then one of time integration alone, and not of the balance.
   type, extends(structure_load_t), abstract :: timed_structure_load_t
      character(max_name) :: timed_by = ""                            !! key by which it has a course; empty: it has none
   contains
      procedure(find_course_of), deferred :: find_course
   end type timed_structure_load_t

   !> A load of white noise: weights times strength times a noise with the covariance delta(t - t'). It is no part of the balance.
   type, extends(structure_load_t), abstract :: random_structure_load_t
      integer :: source = 0                                           !! that loads of the same number share; 0: one of its own
      real(wp) :: strength = 0.0_wp                                   !! [N s**(1/2)]
   end type random_structure_load_t

   abstract interface
      !> Adds the load, with its present numbers, to the spectrum of all loads.
      subroutine add_load(self, structure, omega, loads, slopes)
         import :: spectrum_t, structure_load_t, structure_t, wp
         class(structure_load_t), intent(in) :: self
         type(structure_t), intent(in) :: structure
         real(wp), intent(in) :: omega(:)                             !! base frequencies [rad/s], (n_tones)
         type(spectrum_t), intent(inout) :: loads                     !! [N]
         type(spectrum_t), intent(inout), optional :: slopes          !! their derivatives by j.omega [N s]
      end subroutine add_load

      !> The course of a load that has one, and its amplitudes.
      subroutine find_course_of(self, structure, omega, course, amplitude)
         import :: load_course_t, structure_t, timed_structure_load_t, wp
         class(timed_structure_load_t), intent(in) :: self
         type(structure_t), intent(in) :: structure
         real(wp), intent(in) :: omega(:)                             !! base frequencies [rad/s], (n_tones)
         class(load_course_t), allocatable, intent(out) :: course
         complex(wp), intent(inout) :: amplitude(:)                   !! c [N], zero on entry, (n_dofs)
      end subroutine find_course_of
   end interface

   !> Loads in an array.
   type :: load_box_t
      integer :: object = 0                                           !! its kind, as a `model_number_t` has it
      integer :: i = 0                                                !! its number among those of this kind, as given
      class(structure_load_t), allocatable :: load
   end type load_box_t

contains

   !> The loads that have a course over time.
   subroutine find_timed_loads(loads, structure, omega, timed)
      type(load_box_t), intent(in) :: loads(:)
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(timed_load_t), allocatable, intent(out) :: timed(:)
      integer :: i, n

      allocate (timed(count(is_only_in_time(loads))))
      n = 0
      do i = 1, size(loads)
         select type (load => loads(i)%load)
         class is (timed_structure_load_t)
            if (load%timed_by == "") cycle
            n = n + 1
            allocate (timed(n)%amplitude(structure%n_dofs), source=(0.0_wp, 0.0_wp))
            call load%find_course(structure, omega, timed(n)%course, timed(n)%amplitude)
         end select
      end do
   end subroutine find_timed_loads

   !> The forces of all sources of noise: f(t) = forces*xi(t), of independent xi with the covariance delta(t - t').
   pure subroutine find_random_forces(loads, n_dofs, forces)
      type(load_box_t), intent(in) :: loads(:)
      integer, intent(in) :: n_dofs
      real(wp), allocatable, intent(out) :: forces(:, :)              !! [N s**(1/2)], (n_dofs, n_sources)
      real(wp) :: all_forces(n_dofs, size(loads))
      integer :: numbers(size(loads))                                 ! of the sources
      integer :: i, k, n

      n = 0
      do i = 1, size(loads)
         select type (load => loads(i)%load)
         class is (random_structure_load_t)
            if (.not. allocated(load%weights)) cycle                  ! a problem that has been reported
            k = 0
            if (load%source > 0) k = findloc(numbers(:n), load%source, dim=1)
            if (k == 0) then
               n = n + 1
               k = n
               numbers(k) = load%source
               all_forces(:, k) = 0.0_wp
            end if
            all_forces(load%dofs, k) = all_forces(load%dofs, k) + load%strength*load%weights
         end select
      end do
      forces = all_forces(:, :n)
   end subroutine find_random_forces

   !> Whether a load belongs to time integration alone.
   elemental logical function is_only_in_time(box)
      type(load_box_t), intent(in) :: box

      is_only_in_time = time_key_of(box%load) /= ""
   end function is_only_in_time

   !> Whether a load is noise.
   elemental logical function is_random(box)
      type(load_box_t), intent(in) :: box

      is_random = .false.
      select type (load => box%load)
      class is (random_structure_load_t)
         is_random = .true.
      end select
   end function is_random

   !> Key by which a load has a course over time; empty: it has none.
   pure character(max_name) function time_key_of(load) result(key)
      class(structure_load_t), intent(in) :: load

      key = ""
      select type (load)
      class is (timed_structure_load_t)
         key = load%timed_by
      end select
   end function time_key_of

   !> Adds the derivative of the load by one of its numbers. `is_known` is false if it does not know it: differences then take
   !> its place, which are exact for numbers in which the load is affine (`is_affine_in`).
   subroutine structure_load_add_slope_to(self, number, structure, omega, slope, is_known)
      class(structure_load_t), intent(in) :: self
      type(number_t), intent(in) :: number                            !! one that it declares
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: omega(:)                                !! base frequencies [rad/s], (n_tones)
      type(spectrum_t), intent(inout) :: slope                        !! [N by the unit of the number]
      logical, intent(out) :: is_known

      is_known = .false.
   end subroutine structure_load_add_slope_to

   !> Reports numbers and options that do not fit together.
   subroutine structure_load_check(self, problems)
      class(structure_load_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems
   end subroutine structure_load_check

   !> Whether the load depends on the frequency of its harmonic.
   pure logical function structure_load_depends_on_frequency(self) result(depends)
      class(structure_load_t), intent(in) :: self

      depends = .false.
   end function structure_load_depends_on_frequency

   !> Whether the load depends on the matrices of the structure.
   pure logical function structure_load_depends_on_structure(self) result(depends)
      class(structure_load_t), intent(in) :: self

      depends = .false.
   end function structure_load_depends_on_structure

   !> Whether an input must give the tuple, for a kind that has a key for it.
   pure logical function structure_load_has_tuple(self) result(has)
      class(structure_load_t), intent(in) :: self

      has = .true.
   end function structure_load_has_tuple

   !> Whether the load vanishes, at any frequency.
   pure logical function structure_load_is_zero(self) result(is_zero)
      class(structure_load_t), intent(in) :: self

      is_zero = .false.
   end function structure_load_is_zero

   !> Number of degrees of freedom of a kind with the key `dofs`.
   pure integer function structure_load_n_dofs(self) result(n_dofs)
      class(structure_load_t), intent(in) :: self

      n_dofs = 1
   end function structure_load_n_dofs

   !> Whether another load differs from this one in nothing but its size, as a mistake would.
   pure logical function structure_load_repeats(self, other) result(repeats)
      class(structure_load_t), intent(in) :: self, other

      repeats = .false.
   end function structure_load_repeats
end module hb_structure_load

!> Polynomial of several degrees of freedom and their rates: each term c q_1**a_1 q_2**a_2 ... v_1**b_1 v_2**b_2 ... acts on
!> one of them.
!> Source: docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_polynomial_coupled
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_dofs
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: new_polynomial_coupled, polynomial_coupled_t

   integer, parameter :: block_size = 256                             ! samples at a time

   type, extends(law_t) :: polynomial_coupled_t
      real(wp), allocatable :: coefficients(:)                        !! c, (n_terms)
      integer, allocatable :: acts_on(:)                              !! coordinate that feels the term, (n_terms)
      integer, allocatable :: z_exponents(:, :)                       !! a, (n_terms, n_coordinates)
      integer, allocatable :: v_exponents(:, :)                       !! b, (n_terms, n_coordinates)
   contains
      procedure :: read => polynomial_coupled_read
      procedure :: evaluate => polynomial_coupled_evaluate
      procedure :: potential => polynomial_coupled_potential
   end type polynomial_coupled_t

contains

   !> Polynomial of the given terms.
   pure subroutine new_polynomial_coupled(self, coefficients, acts_on, z_exponents, v_exponents)
      class(polynomial_coupled_t), intent(inout) :: self
      real(wp), intent(in) :: coefficients(:)                         !! [N per product of powers], (n_terms)
      integer, intent(in) :: acts_on(:)                               !! (n_terms)
      integer, intent(in) :: z_exponents(:, :)                        !! (n_terms, n_coordinates), >= 0
      integer, intent(in) :: v_exponents(:, :)                        !! (n_terms, n_coordinates), >= 0

      self%coefficients = coefficients
      self%acts_on = acts_on
      self%z_exponents = z_exponents
      self%v_exponents = v_exponents
      self%degree = max(1, maxval(sum(z_exponents, dim=2) + sum(v_exponents, dim=2)))
      self%needs_velocity = any(v_exponents > 0)
      self%has_potential = is_gradient(self)
      self%is_odd = all(modulo(sum(z_exponents, dim=2) + sum(v_exponents, dim=2), 2) == 1 .or. abs(coefficients) <= 0.0_wp)
   end subroutine new_polynomial_coupled

   !> Reads a `&law type = 'polynomial_coupled'` group.
   subroutine polynomial_coupled_read(self, group, structure)
      class(polynomial_coupled_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(string_t), allocatable :: names(:)
      real(wp), allocatable :: coefficients(:)
      integer, allocatable :: acts_on(:), v_exponents(:, :), v_list(:), z_exponents(:, :), z_list(:)
      integer :: i

      self%has_potential = .true.                                     ! until it is known
      call read_dofs(self, group, structure)
      call group%get("coefficients", coefficients)
      if (.not. (allocated(self%dofs) .and. allocated(coefficients))) return
      call group%get("acts_on", names, n=size(coefficients))
      allocate (z_list(size(coefficients)*size(self%dofs)), v_list(size(coefficients)*size(self%dofs)), source=0)
      call group%get("displacement_exponents", z_list)
      call group%get("velocity_exponents", v_list)
      call sort_by_term(group, "displacement_exponents", z_list, size(coefficients), size(self%dofs), z_exponents)
      call sort_by_term(group, "velocity_exponents", v_list, size(coefficients), size(self%dofs), v_exponents)
      if (.not. (allocated(names) .and. allocated(z_exponents) .and. allocated(v_exponents))) return
      if (size(names) /= size(coefficients)) return
      do i = 1, size(coefficients)
         if (all(z_exponents(i, :) == 0) .and. all(v_exponents(i, :) == 0)) then
            call group%problem("coefficients", "term "//to_text(i)//" has no exponent: a constant force is a &load of the "// &
                               "zero tuple")
         end if
      end do
      call find_coordinates(self, names, group, structure, acts_on)
      if (allocated(acts_on)) call new_polynomial_coupled(self, coefficients, acts_on, z_exponents, v_exponents)
   end subroutine polynomial_coupled_read

   !> Turns a list of exponents, term after term, into a table; not allocated when the list has another length.
   subroutine sort_by_term(group, key, list, n_terms, n_dofs, exponents)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      integer, intent(in) :: list(:), n_terms, n_dofs
      integer, allocatable, intent(out) :: exponents(:, :)            !! (n_terms, n_dofs)

      if (size(list) == n_terms*n_dofs) then
         exponents = transpose(reshape(list, [n_dofs, n_terms]))
      else
         call group%problem(key, "give one exponent for each of the "//to_text(n_dofs)//" degrees of freedom and "// &
                            to_text(n_terms)//" terms, "//to_text(n_terms*n_dofs)//" in all, not "//to_text(size(list)))
      end if
   end subroutine sort_by_term

   !> Places of the named degrees of freedom among those of the law; not allocated after a problem.
   subroutine find_coordinates(self, names, group, structure, places)
      class(polynomial_coupled_t), intent(in) :: self
      type(string_t), intent(in) :: names(:)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      integer, allocatable, intent(out) :: places(:)
      type(error_t), allocatable :: error
      integer :: dof, i

      allocate (places(size(names)))
      do i = 1, size(names)
         call structure%find_dof(names(i)%value, dof, error)
         if (allocated(error)) then
            call group%problem("acts_on", error%message)
            deallocate (places)
            return
         end if
         places(i) = findloc(self%dofs, dof, dim=1)
         if (places(i) == 0) then
            call group%problem("acts_on", "'"//names(i)%value//"' must be one of 'dofs' as well")
            deallocate (places)
            return
         end if
      end do
   end subroutine find_coordinates

   subroutine polynomial_coupled_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: term(block_size)
      integer :: b, first, i, last, n

      f = 0.0_wp
      if (present(df_dz)) df_dz = 0.0_wp
      if (present(df_dv)) df_dv = 0.0_wp
      do first = 1, size(z, 1), block_size
         last = min(first + block_size - 1, size(z, 1))
         n = last - first + 1
         do i = 1, size(self%coefficients)
            associate (a => self%acts_on(i))
               call find_term(self, i, z(first:last, :), v(first:last, :), 0, 0, term(1:n))
               f(first:last, a) = f(first:last, a) + term(1:n)
               do b = 1, size(z, 2)
                  if (present(df_dz) .and. self%z_exponents(i, b) > 0) then
                     call find_term(self, i, z(first:last, :), v(first:last, :), b, 0, term(1:n))
                     df_dz(first:last, a, b) = df_dz(first:last, a, b) + term(1:n)
                  end if
                  if (present(df_dv) .and. self%v_exponents(i, b) > 0) then
                     call find_term(self, i, z(first:last, :), v(first:last, :), 0, b, term(1:n))
                     df_dv(first:last, a, b) = df_dv(first:last, a, b) + term(1:n)
                  end if
               end do
            end associate
         end do
      end do
   end subroutine polynomial_coupled_evaluate

   !> Term i, or its derivative by displacement `by_z` or by rate `by_v` (0: by none).
   pure subroutine find_term(self, i, z, v, by_z, by_v, term)
      class(polynomial_coupled_t), intent(in) :: self
      integer, intent(in) :: i, by_z, by_v
      real(wp), intent(in) :: z(:, :), v(:, :)
      real(wp), intent(out) :: term(:)
      integer :: c

      term = self%coefficients(i)
      do c = 1, size(z, 2)
         call multiply(term, z(:, c), self%z_exponents(i, c), c == by_z)
         if (self%needs_velocity) call multiply(term, v(:, c), self%v_exponents(i, c), c == by_v)
      end do
   end subroutine find_term

   !> Multiplies by x**n, or by its derivative n x**(n - 1).
   pure subroutine multiply(term, x, n, is_derivative)
      real(wp), intent(inout) :: term(:)
      real(wp), intent(in) :: x(:)
      integer, intent(in) :: n
      logical, intent(in) :: is_derivative

      if (is_derivative) then
         term = term*n*x**(n - 1)
      else if (n > 0) then
         term = term*x**n
      end if
   end subroutine multiply

   !> Whether the terms without a rate are a gradient: each derivative of the candidate below must give back the terms that
   !> act on its coordinate.
   pure logical function is_gradient(self)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), parameter :: digits = 1.0e-12_wp                      ! coefficients come from a file
      integer :: exponents(size(self%z_exponents, 2)), a, b, i, k
      real(wp) :: candidate, given, largest

      is_gradient = .true.
      do i = 1, size(self%coefficients)
         if (any(self%v_exponents(i, :) > 0)) cycle
         exponents = self%z_exponents(i, :)
         exponents(self%acts_on(i)) = exponents(self%acts_on(i)) + 1
         do b = 1, size(exponents)
            if (exponents(b) == 0) cycle
            candidate = 0.0_wp
            given = 0.0_wp
            largest = 0.0_wp
            do k = 1, size(self%coefficients)
               if (any(self%v_exponents(k, :) > 0)) cycle
               a = self%acts_on(k)
               if (any(self%z_exponents(k, :) /= exponents - unit(a))) cycle
               largest = max(largest, abs(self%coefficients(k)))
               candidate = candidate + exponents(b)*self%coefficients(k)/sum(exponents)
               if (a == b) given = given + self%coefficients(k)
            end do
            if (abs(candidate - given) > digits*largest) is_gradient = .false.
         end do
      end do

   contains

      pure function unit(place)
         integer, intent(in) :: place
         integer :: unit(size(exponents))

         unit = 0
         unit(place) = 1
      end function unit
   end function is_gradient

   !> Sum of z_a c z**a/(degree + 1) over the terms without a rate, a the coordinate on which each acts: by Euler's theorem on
   !> homogeneous functions the potential, where there is one.
   subroutine polynomial_coupled_potential(self, z, energy, gradient)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: term(size(z, 1))
      integer :: c, i

      energy = 0.0_wp
      gradient = 0.0_wp
      do i = 1, size(self%coefficients)
         if (any(self%v_exponents(i, :) > 0)) cycle
         term = self%coefficients(i)
         do c = 1, size(z, 2)
            call multiply(term, z(:, c), self%z_exponents(i, c), .false.)
         end do
         associate (a => self%acts_on(i))
            energy = energy + z(:, a)*term/(sum(self%z_exponents(i, :)) + 1)
            gradient(:, a) = gradient(:, a) + term
         end associate
      end do
   end subroutine polynomial_coupled_potential
end module hb_law_polynomial_coupled

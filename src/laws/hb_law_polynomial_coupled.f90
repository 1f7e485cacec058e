!> Polynomial of several degrees of freedom and their rates: each term c q_1**a_1 q_2**a_2 ... v_1**b_1 v_2**b_2 ...
!> acts on one of them. Terms come from lists, or from a text table with one term per line, such as the quadratic and
!> cubic tensors of reduced models of geometric nonlinearity; they are stored and evaluated by the few factors of
!> each. Source: docs/why/theory.md, section 5.1; M. P. Mignolet, A. Przekop, S. A. Rizzi and S. M. Spottswood, J.
!> Sound Vib. 332 (2013) 2437 (reduced models). Sign: f stands beside K q on the left-hand side.
module hb_law_polynomial_coupled
   use hb_kinds, only: wp
   use hb_law, only: law_t, placement_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: factors_of_term, new_polynomial_coupled, polynomial_coupled_t

   integer, parameter :: block_size = 256                             ! samples at a time

   type, extends(law_t) :: polynomial_coupled_t
      integer :: n_coordinates = 0
      real(wp), allocatable :: coefficients(:)                        !! c, (n_terms)
      integer, allocatable :: acts_on(:)                              !! coordinate on which the term acts, (n_terms)
      integer, allocatable :: first(:)                                !! first factor of each term, and one more, (n_terms + 1)
      integer, allocatable :: factor(:)                               !! coordinate, or n_coordinates and the coordinate of a rate;
                                                                      !! ascending in each term, a power by repetition
      character(:), allocatable :: file_fingerprint                   !! of the file of the terms, if there is one
   contains
      procedure :: declare_numbers => polynomial_coupled_declare_numbers
      procedure :: placement => polynomial_coupled_placement
      procedure :: derive => polynomial_coupled_derive
      procedure :: number_slope => polynomial_coupled_number_slope
      procedure :: evaluate => polynomial_coupled_evaluate
      procedure :: potential => polynomial_coupled_potential
      procedure :: fingerprint => polynomial_coupled_fingerprint
   end type polynomial_coupled_t

contains

   !> Creates a polynomial of the given terms.
   pure subroutine new_polynomial_coupled(self, coefficients, acts_on, z_exponents, v_exponents)
      class(polynomial_coupled_t), intent(inout) :: self
      real(wp), intent(in) :: coefficients(:)                         !! [N per product of powers], (n_terms)
      integer, intent(in) :: acts_on(:)                               !! (n_terms)
      integer, intent(in) :: z_exponents(:, :)                        !! (n_terms, n_coordinates), >= 0
      integer, intent(in) :: v_exponents(:, :)                        !! (n_terms, n_coordinates), >= 0
      integer :: exponents(2*size(z_exponents, 2)), i

      self%n_coordinates = size(z_exponents, 2)
      self%coefficients = coefficients
      self%acts_on = acts_on
      self%first = [1]
      self%factor = [integer ::]
      do i = 1, size(coefficients)
         exponents = [z_exponents(i, :), v_exponents(i, :)]
         self%factor = [self%factor, factors_of_term(exponents)]
         self%first = [self%first, size(self%factor) + 1]
      end do
      call self%derive()
   end subroutine new_polynomial_coupled

   !> Those of a table in a file are not numbers of the law.
   subroutine polynomial_coupled_declare_numbers(self, numbers)
      class(polynomial_coupled_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      if (.not. allocated(self%file_fingerprint)) call numbers%add("coefficients", self%coefficients)
   end subroutine polynomial_coupled_declare_numbers

   pure function polynomial_coupled_placement(self) result(placement)
      class(polynomial_coupled_t), intent(in) :: self
      type(placement_t) :: placement

      placement%is_by_dofs = .true.
   end function polynomial_coupled_placement

   !> Factors of a term, each as often as its exponent says.
   pure function factors_of_term(exponents) result(factors)
      integer, intent(in) :: exponents(:)                             !! of the coordinates, then of their rates
      integer, allocatable :: factors(:)
      integer :: c, k

      factors = [((c, k=1, exponents(c)), c=1, size(exponents))]
   end function factors_of_term

   !> Sets the properties that follow from the terms.
   pure subroutine polynomial_coupled_derive(self)
      class(polynomial_coupled_t), intent(inout) :: self

      associate (degrees => self%first(2:) - self%first(:size(self%first) - 1))
         self%degree = max(1, maxval(degrees))
         self%is_odd = all(modulo(degrees, 2) == 1 .or. abs(self%coefficients) <= 0.0_wp)
      end associate
      self%needs_velocity = any(self%factor > self%n_coordinates)
      self%needs_displacement = any(self%factor <= self%n_coordinates)
      self%has_potential = is_gradient(self)
   end subroutine polynomial_coupled_derive

   !> Fingerprint of the file of the terms, if there is one.
   function polynomial_coupled_fingerprint(self) result(text)
      class(polynomial_coupled_t), intent(in) :: self
      character(300) :: text

      text = ""
      if (allocated(self%file_fingerprint)) text = self%file_fingerprint
   end function polynomial_coupled_fingerprint

   subroutine polynomial_coupled_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: value(block_size)
      integer :: begin, end, i, k

      f = 0.0_wp
      if (present(df_dz)) df_dz = 0.0_wp
      if (present(df_dv)) df_dv = 0.0_wp
      do begin = 1, size(z, 1), block_size
         end = min(begin + block_size - 1, size(z, 1))
         do i = 1, size(self%coefficients)
            associate (a => self%acts_on(i), f_i => value(1:end - begin + 1))
               call find_term(self, i, z(begin:end, :), v(begin:end, :), 0, f_i)
               f(begin:end, a) = f(begin:end, a) + f_i
               do k = self%first(i), self%first(i + 1) - 1
                  associate (c => self%factor(k), n => self%n_coordinates)
                     if (any(self%factor(self%first(i):k - 1) == c)) cycle
                     if (c <= n .and. present(df_dz)) then
                        call find_term(self, i, z(begin:end, :), v(begin:end, :), k, f_i)
                        df_dz(begin:end, a, c) = df_dz(begin:end, a, c) + f_i
                     else if (c > n .and. present(df_dv)) then
                        call find_term(self, i, z(begin:end, :), v(begin:end, :), k, f_i)
                        df_dv(begin:end, a, c - n) = df_dv(begin:end, a, c - n) + f_i
                     end if
                  end associate
               end do
            end associate
         end do
      end do
   end subroutine polynomial_coupled_evaluate

   subroutine polynomial_coupled_number_slope(self, number, z, v, p, slope, is_known)
      class(polynomial_coupled_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      integer :: i

      is_known = number%key == "coefficients"
      if (.not. is_known) return
      i = max(1, number%element(1))
      slope = 0.0_wp
      associate (value => slope(:, self%acts_on(i)))
         value = 1.0_wp
         call multiply_factors(self, i, 0, z, v, value)
      end associate
   end subroutine polynomial_coupled_number_slope

   !> Term i, or its derivative with respect to the coordinate or rate of one of its factors (0: none).
   pure subroutine find_term(self, i, z, v, by_factor, value)
      class(polynomial_coupled_t), intent(in) :: self
      integer, intent(in) :: i, by_factor
      real(wp), intent(in) :: z(:, :), v(:, :)
      real(wp), intent(out) :: value(:)

      associate (own => self%factor(self%first(i):self%first(i + 1) - 1))
         value = self%coefficients(i)
         if (by_factor > 0) value = value*count(own == self%factor(by_factor))
      end associate
      call multiply_factors(self, i, by_factor, z, v, value)
   end subroutine find_term

   !> Multiplies by all factors of term i but one (0: by all).
   pure subroutine multiply_factors(self, i, but, z, v, value)
      class(polynomial_coupled_t), intent(in) :: self
      integer, intent(in) :: i, but
      real(wp), intent(in) :: z(:, :), v(:, :)
      real(wp), intent(inout) :: value(:)
      integer :: k

      do k = self%first(i), self%first(i + 1) - 1
         if (k == but) cycle
         if (self%factor(k) <= self%n_coordinates) then
            value = value*z(:, self%factor(k))
         else
            value = value*v(:, self%factor(k) - self%n_coordinates)
         end if
      end do
   end subroutine multiply_factors

   !> Whether the terms without a rate are a gradient: for the terms from one product of powers, those on each
   !> coordinate must satisfy Euler's theorem for their sum. Products are sorted by their exponents, coordinate by
   !> coordinate.
   pure logical function is_gradient(self)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), parameter :: coefficient_rounding = 1.0e-12_wp        ! coefficients come from a file
      integer, allocatable :: exponents(:, :), order(:), sorted(:)
      real(wp) :: given(self%n_coordinates), largest, total
      integer :: b, e, first, i, k, last

      order = pack([(i, i=1, size(self%coefficients))], [(.not. has_rate(self, i), i=1, size(self%coefficients))])
      allocate (exponents(2*self%n_coordinates, size(self%coefficients)), source=0)
      do i = 1, size(self%coefficients)
         do k = self%first(i), self%first(i + 1) - 1
            exponents(self%factor(k), i) = exponents(self%factor(k), i) + 1
         end do
         exponents(self%acts_on(i), i) = exponents(self%acts_on(i), i) + 1
      end do
      do b = 1, self%n_coordinates
         allocate (sorted(0))
         do e = 0, maxval(exponents(b, :))
            sorted = [sorted, pack(order, exponents(b, order) == e)]
         end do
         call move_alloc(sorted, order)
      end do
      is_gradient = .true.
      first = 1
      do while (first <= size(order))
         associate (product => exponents(:self%n_coordinates, order(first)))
            given = 0.0_wp
            largest = 0.0_wp
            do last = first, size(order)
               if (any(exponents(:self%n_coordinates, order(last)) /= product)) exit
               associate (c => self%coefficients(order(last)), a => self%acts_on(order(last)))
                  given(a) = given(a) + c
                  largest = max(largest, abs(c))
               end associate
            end do
            total = sum(given)
            if (any(abs(product*total/sum(product) - given) > coefficient_rounding*largest)) is_gradient = .false.
         end associate
         first = last
      end do
   end function is_gradient

   pure logical function has_rate(self, i)
      class(polynomial_coupled_t), intent(in) :: self
      integer, intent(in) :: i

      has_rate = any(self%factor(self%first(i):self%first(i + 1) - 1) > self%n_coordinates)
   end function has_rate

   !> Sum of z_a c z**a/(degree + 1) over the terms without a rate, where a is the coordinate on which each acts: by
   !> Euler's theorem on homogeneous functions this is the potential, if there is one.
   subroutine polynomial_coupled_potential(self, z, energy, gradient)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: value(size(z, 1))
      integer :: i

      energy = 0.0_wp
      gradient = 0.0_wp
      do i = 1, size(self%coefficients)
         if (has_rate(self, i)) cycle
         call find_term(self, i, z, z, 0, value)
         associate (a => self%acts_on(i))
            energy = energy + z(:, a)*value/(self%first(i + 1) - self%first(i) + 1)
            gradient(:, a) = gradient(:, a) + value
         end associate
      end do
   end subroutine polynomial_coupled_potential
end module hb_law_polynomial_coupled
